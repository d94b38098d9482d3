// The seam between the command line (app.cc) and `orbitune campaign ...` and `orbitune report`: what each may be told.
// Every Run function prints its results or its error, and returns the exit code.
#pragma once

#include "client/cli/commands.h"

namespace orbitune::cli {

// Where initial conditions come from: a file, or so many draws.
struct InitialConditionOptions {
  std::string file;  // CSV or JSON
  std::optional<std::int32_t> count;
  std::string distribution;  // a JSON file; empty: the scenario's own
  std::optional<std::uint64_t> seed;
};

struct CampaignCreateOptions {
  SubmitOptions
      job;  // what the initial conditions' jobs have in common; its seed is the draws' too, unless that is set
  InitialConditionOptions initial_conditions;
  std::string held_out_file;
  std::optional<std::int32_t> held_out_count;
  bool tune_held_out = false;
  bool robust = false;
  std::string robust_objective;  // mean, worst, percentile:LEVEL or cvar:LEVEL
  std::optional<std::int64_t> robust_episodes;
};
int RunCampaignCreate(Session& session, const CampaignCreateOptions& options);

struct CampaignListOptions {
  std::string state;
  std::int64_t limit = 0;  // 0: all
};
int RunCampaignList(Session& session, const CampaignListOptions& options);

int RunCampaignShow(Session& session, const std::string& campaign);

struct CampaignWatchOptions {
  std::string campaign;
  std::optional<std::int64_t> from;  // resume_after_seq
  double reconnect_s = 60;
};
int RunCampaignWatch(Session& session, const CampaignWatchOptions& options);

// Tries every campaign; the exit code is that of the first failure.
int RunCampaignTransition(Session& session, Transition transition, const std::vector<std::string>& campaigns);

struct CampaignExtendOptions {
  std::string campaign;
  InitialConditionOptions initial_conditions;
  std::string request_id;  // empty: a random one
  bool watch = false;
  double reconnect_s = 60;
};
int RunCampaignExtend(Session& session, const CampaignExtendOptions& options);

int RunCampaignMembers(Session& session, const std::string& campaign);

struct CampaignExportOptions {
  std::string campaign;
  std::string format = "csv";
  std::string output;  // empty: stdout
};
int RunCampaignExport(Session& session, const CampaignExportOptions& options);

struct ReportOptions {
  std::string name;  // jobs/ID or campaigns/ID
  std::string output;
};
int RunReport(Session& session, const ReportOptions& options);

}  // namespace orbitune::cli
