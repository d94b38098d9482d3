// Campaigns as the store keeps them: one tuning over many initial conditions. Each initial condition is a member with
// an ordinary job of its own; the robust job, if asked for, is one more member. A campaign begins, halts and ends them
// together, and keeps what comes of comparing them.
#pragma once

#include <array>

#include "storage/job.h"

namespace orbitune {

// kRunning -> kEvaluating once every job has ended -> kSucceeded, or kFailed where no initial condition's job
// succeeded.
enum class CampaignState { kRunning, kPaused, kEvaluating, kSucceeded, kFailed, kCancelled };

// Only an extension leads out of kSucceeded and kFailed, and nothing out of kCancelled.
inline bool IsTerminal(CampaignState state) {
  return state == CampaignState::kSucceeded || state == CampaignState::kFailed || state == CampaignState::kCancelled;
}

enum class MemberRole { kTuned, kHeldOut, kRobust };
inline constexpr std::size_t kMemberRoles = 3;

// Members are numbered from 1, dense, within their role, in the order of their coming. Ordered as they are listed.
struct MemberId {
  MemberRole role = MemberRole::kTuned;
  int number = 0;

  auto operator<=>(const MemberId&) const = default;
};

// One K for all tuned initial conditions, found by a job over the whole set.
struct RobustTuning {
  SearchOptions search;
  Objective objective;
};

// Where initial conditions were drawn (core/scenario/distribution.h). A campaign extended goes on behind the last draw,
// and so is the longer one.
struct InitialConditionDraws {
  IcDistribution distribution;
  std::uint64_t seed = 0;
  int count = 0;  // so far, from index 0
};

// Everything that a campaign's members follow from, the initial conditions excepted: those are the members' own.
struct CampaignSpec {
  std::string display_name;
  std::map<std::string, std::string> labels;
  Scenario scenario;       // its search: that of tuned member 1; member n has the seed of it + n - 1
  std::string warm_start;  // as JobSpec's
  std::optional<InitialConditionDraws> draws;           // of the tuned; none: they were listed
  std::optional<InitialConditionDraws> held_out_draws;  // of the held-out
  bool tune_held_out = false;                           // each by a job of its own, to compare with
  std::optional<RobustTuning> robust;
  std::string owner;  // as JobSpec's, and of all its jobs, like the next two
  std::string peer;
  int priority = 0;
};

// Whose gains are flown.
enum class GainsChoice {
  kInitial,  // K(1)
  kTuned,    // K*, of the initial condition's own job: K(M) of ARS, the best K of the others
  kBest,     // the best K of its own job
  kMean,     // K-hat, the arithmetic mean of K* over the tuned initial conditions
  kRobust,   // the best K of the newest robust job
  kNearest,  // K* of the tuned initial condition nearest in x(0); held-out ones only
};
inline constexpr std::size_t kGainsChoices = 6;

// What one choice gives at one initial condition.
struct MemberEpisode {
  GainsChoice choice = GainsChoice::kInitial;
  Gains gains{};
  Outcome outcome = Outcome::kNumericalFailure;
  double cost = kUnset;  // NaN unless HasCost(outcome); so are the rest
  int settling_samples = 0;
  double fuel_sum = kUnset;
  double delta_v_to_settling_m_s = kUnset;  // where the member's job measured it; else NaN
};

// Of the numbers compared; all NaN where there are none.
struct ReductionStatistics {
  double average = kUnset;
  double minimum = kUnset;
  double maximum = kUnset;
  std::array<double, 5> percentiles{kUnset, kUnset, kUnset, kUnset, kUnset};  // of kPercentiles
};
inline constexpr std::array<double, 5> kPercentiles{5, 25, 50, 75, 95};

// One choice over the tuned, or over the held-out, initial conditions. Reductions are in percent of the value under
// K(1), positive is less, over those that have a cost under both.
struct GainsComparison {
  GainsChoice choice = GainsChoice::kInitial;
  MemberRole over = MemberRole::kTuned;
  int flown = 0;
  int settled = 0;
  int not_settled = 0;   // within the horizon; they have a cost, and are compared
  int without_cost = 0;  // left the domain or failed
  int compared = 0;
  ReductionStatistics cost_percent;
  ReductionStatistics settling_time_percent;
  ReductionStatistics fuel_sum_percent;
  ReductionStatistics delta_v_percent;  // all NaN where it was not measured
};

struct CampaignResults {
  int mean_of = 0;  // initial conditions whose K* are in the mean
  Gains mean_gains{};
  std::optional<Gains> robust_gains;
  std::vector<GainsComparison> comparisons;
  std::optional<GainsChoice> best_on_held_out;  // of the choices that need no tuning there
  std::string conclusion;                       // the same in words, with what failed
  std::int64_t episodes = 0;                    // simulated by the searches
};

// One of a campaign's jobs has ended.
struct MemberEnded {
  MemberId member;
  std::string job_id;
  JobState state = JobState::kSucceeded;
  TimeUs time_us = 0;
};

struct CampaignStateChange {
  CampaignState state = CampaignState::kRunning;
  TimeUs time_us = 0;
  std::string message;                     // why, where kFailed; what was added, where extended
  std::optional<CampaignResults> results;  // where kSucceeded
};

// One entry of a campaign's sequence; seq is dense from 1 (the change to kRunning at creation).
struct CampaignEvent {
  std::int64_t seq = 0;
  std::variant<MemberEnded, CampaignStateChange> what;
};

struct MemberCounts {
  int members = 0;
  int jobs = 0;
  int ended = 0;  // of the jobs
  int succeeded = 0;
  int running = 0;
  std::int64_t iterations = 0;  // completed by the jobs
};

// A campaign as of its newest committed event.
struct CampaignRecord {
  std::string id;
  CampaignSpec spec;
  CampaignState state = CampaignState::kRunning;
  TimeUs create_time_us = 0;
  TimeUs end_time_us = 0;     // 0: not yet
  TimeUs update_time_us = 0;  // of the newest state change
  std::int64_t last_seq = 0;
  std::int64_t state_changes = 0;  // so far; the etag is made of it
  std::array<MemberCounts, kMemberRoles> counts{};
  std::optional<CampaignResults> results;
  std::string error_message;

  const MemberCounts& of(MemberRole role) const { return counts[static_cast<std::size_t>(role)]; }
};

struct CampaignMember {
  MemberId id;
  OrbitState initial_condition;         // std::monostate for a robust member: it has those of the tuned
  std::string job_id;                   // empty: none
  std::vector<MemberEpisode> episodes;  // once the campaign has succeeded, in the order of GainsChoice
};

}  // namespace orbitune
