// Jobs as the store keeps them: the exact inputs, the state, the history and the report, in domain types.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "core/library/gain_set.h"
#include "core/scenario/scenario.h"
#include "core/search/objective.h"
#include "core/search/search.h"
#include "storage/provenance.h"

namespace orbitune {

enum class JobState { kQueued, kRunning, kPaused, kSucceeded, kFailed, kCancelled };

// No transition leads out of these.
inline bool IsTerminal(JobState state) {
  return state == JobState::kSucceeded || state == JobState::kFailed || state == JobState::kCancelled;
}

// Microseconds since the Unix epoch, UTC.
using TimeUs = std::int64_t;

inline constexpr int kLowestPriority = -4;
inline constexpr int kHighestPriority = 4;

// Everything a job's results are a function of, and how its owner calls it. Never changes.
struct JobSpec {
  std::string display_name;
  std::map<std::string, std::string> labels;
  Scenario scenario;                           // scenario.search holds the job's own hyperparameters
  OrbitState initial_condition;                // what is flown, never std::monostate; the first of several
  std::vector<OrbitState> initial_conditions;  // robust tuning: all that are flown under one K; else none
  Objective objective;                         // over the costs of several
  std::string warm_start;   // jobs/ID or gainSets/ID, whose gains scenario.search.initial_gains are; else empty
  std::string campaign_id;  // that the job is part of; else empty
  std::string owner;        // name of the token that created it; empty: nobody's
  std::string peer;         // IP address that it came from, where it has no owner
  int priority = 0;         // in [kLowestPriority, kHighestPriority]; of the workers' time it gets 2^priority parts

  // What is flown.
  std::span<const OrbitState> starts() const {
    return initial_conditions.empty() ? std::span(&initial_condition, 1) : std::span(initial_conditions);
  }
};

// An episode over the full horizon, in physical units; NaN where an episode does not have the value.
struct EpisodeReport {
  Outcome outcome = Outcome::kNumericalFailure;
  std::string outcome_message;
  double end_time_s = kUnset;
  double cost = kUnset;
  int settling_samples = 0;
  double settling_time_s = kUnset;
  double fuel_sum = kUnset;
  double delta_v_to_settling_m_s = kUnset;
  double delta_v_horizon_m_s = kUnset;
  double peak_acceleration_m_s2 = kUnset;
  double initial_lyapunov = kUnset;
  bool domain_guaranteed = false;  // V(0) < (1 - e_r)^2 / 2
};

// Of some quantity over initial conditions; NaN where there are none to tell of.
struct Spread {
  double mean = kUnset;
  double min = kUnset;
  double max = kUnset;
};

// One K over several initial conditions. Reductions are 1 - J / J(K(1)) and so on, in percent, of the initial
// conditions that have a cost under this K and under K(1).
struct EnsembleReport {
  int initial_conditions = 0;
  int settled = 0;
  double objective = kUnset;  // what the search minimised; NaN where one of them has no cost
  Spread cost;
  Spread cost_reduction_percent;
  Spread settling_time_reduction_percent;
  Spread fuel_sum_reduction_percent;
};

struct GainsAssessment {
  int iteration = 0;
  Gains gains{};
  // Over several initial conditions: the worst outcome, the largest peak acceleration and V(0), the guarantee if all
  // have it, and the mean of everything else.
  EpisodeReport episode;
  std::optional<EnsembleReport> ensemble;  // over several initial conditions
};

enum class WarningKind {
  kGainAtFloor,
  kLastNotBest,
  kPeakAcceleration,
  kNotSettled,
  kDeltaVRose,
  kPairsLeftOut,
};

struct Warning {
  WarningKind kind = WarningKind::kGainAtFloor;
  std::string message;
};

// What a job that succeeded found.
struct JobReport {
  GainsAssessment initial;  // K(1)
  GainsAssessment final;    // K(M)
  GainsAssessment best;     // the best K(i)
  std::vector<Warning> warnings;
  std::int64_t episodes = 0;  // simulated by the search
};

struct StateChange {
  JobState state = JobState::kQueued;
  TimeUs time_us = 0;
  std::string message;              // why, where kFailed
  std::optional<JobReport> report;  // where kSucceeded
  std::optional<GainSet> gain_set;  // where kSucceeded; stored with the change, not read back with it
};

// One entry of a job's sequence; seq is dense from 1 (the change to kQueued at creation).
struct JobEvent {
  std::int64_t seq = 0;
  std::variant<IterationRecord, StateChange> what;
};

// A job as of its newest committed event.
struct JobRecord {
  std::string id;
  JobSpec spec;
  JobState state = JobState::kQueued;
  TimeUs create_time_us = 0;
  TimeUs start_time_us = 0;   // 0: not yet
  TimeUs end_time_us = 0;     // 0: not yet
  TimeUs update_time_us = 0;  // of the newest state change
  std::int64_t last_seq = 0;
  std::int64_t state_changes = 0;  // so far; the etag is made of it
  std::optional<IterationRecord> first;
  std::optional<IterationRecord> latest;
  std::optional<IterationRecord> best;  // by Better (core/search/search.h), the earliest of equals
  std::vector<double> checkpoint;       // the search's before `latest`; of a job that has not ended
  std::optional<JobReport> report;
  std::string error_message;
  TimeUs iterations_removed_us = 0;  // when its iterations but first, best and latest were removed; 0: all are there
  std::optional<Provenance> provenance;  // none: it ended under a server that kept none

  int completed_iterations() const { return latest ? latest->iteration : 0; }
};

}  // namespace orbitune
