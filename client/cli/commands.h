// The seam between the command line (app.cc, the one file that sees CLI11) and the commands: what each may be told.
// Every Run function prints its results or its error, and returns the exit code.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/cli/search_flags.h"

namespace orbitune::cli {

class Session;

struct ScenariosOptions {
  std::string name;  // empty: list them all
};
int RunScenarios(Session& session, const ScenariosOptions& options);

// What is flown: a scenario by name or from a file, and possibly another initial condition.
struct FlightOptions {
  std::string scenario;
  std::string scenario_file;
  std::string initial_condition;  // a file or key=value,...
};

struct WatchOptions {
  std::string job;
  bool every = false;                // plain lines on a terminal, too
  std::optional<std::int64_t> from;  // resume_after_seq
  double reconnect_s = 60;
};
int RunWatch(Session& session, const WatchOptions& options);

struct SubmitOptions {
  FlightOptions flight;
  std::string display_name;
  std::vector<std::string> labels;  // key=value
  std::int32_t priority = 0;
  std::optional<std::int32_t> iterations;
  std::optional<double> step_size;
  std::optional<double> exploration_scale;
  std::optional<std::int32_t> directions;
  std::string initial_gains;
  std::string exploration_std;
  std::optional<double> gain_floor;
  std::optional<std::uint64_t> seed;
  SearchFlags search;
  std::string warm_start;               // jobs/ID or gainSets/ID
  std::string initial_conditions_file;  // robust tuning
  std::string objective;
  bool relative = false;
  std::string request_id;  // empty: a random one
  bool validate_only = false;
  bool watch = false;
  double reconnect_s = 60;
};
int RunSubmit(Session& session, const SubmitOptions& options);

struct JobsOptions {
  std::string filter;
  std::string state;
  std::vector<std::string> labels;
  std::string scenario;
  std::string order_by;
  std::int64_t limit = 0;  // 0: all
};
int RunJobs(Session& session, const JobsOptions& options);

int RunShow(Session& session, const std::string& job);

struct HistoryOptions {
  std::string job;
  std::string format = "csv";
  std::string output;  // empty: stdout
};
int RunHistory(Session& session, const HistoryOptions& options);

struct VerifyOptions {
  std::string job;
  std::int32_t from = 0;  // iterations; 0: the first, the newest
  std::int32_t to = 0;
};
int RunVerify(Session& session, const VerifyOptions& options);

enum class Transition { kCancel, kPause, kResume, kDelete };
// Tries every job; the exit code is that of the first failure.
int RunTransition(Session& session, Transition transition, const std::vector<std::string>& jobs);

struct SimulateOptions {
  FlightOptions flight;
  std::string job;
  std::string which = "best";  // of the job's gains
  std::string gains;
  std::string csv;  // a file, or "-"
  std::int32_t stride = 0;
  bool early_exit = false;
  bool trajectory = false;  // in the JSON output
};
int RunSimulate(Session& session, const SimulateOptions& options);

// Whose the token is, and what it may do.
int RunWhoami(Session& session);

}  // namespace orbitune::cli
