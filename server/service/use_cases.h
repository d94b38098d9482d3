// The use cases, in domain types, once for every transport. Validation lives here.
#pragma once

#include <optional>

#include "core/scenario/presets.h"
#include "server/jobs/event_hub.h"
#include "server/jobs/scheduler.h"
#include "server/service/warm_start.h"
#include "storage/job_store.h"

namespace orbitune {

constexpr std::size_t kLongestName = 256;  // of what a user names, in bytes

// Where a scenario comes from: exactly one of the two.
struct ScenarioChoice {
  std::string preset_id;  // without "scenarios/"
  std::optional<Scenario> definition;
};

// Hyperparameters as a user gives them: what is unset takes the scenario's value.
struct SearchOverrides {
  std::optional<int> iterations;
  std::optional<double> step_size;
  std::optional<double> exploration_scale;
  std::optional<int> directions;
  std::optional<Gains> initial_gains;
  std::optional<Gains> exploration_std;
  std::optional<double> gain_floor;
  std::optional<std::uint64_t> seed;
  std::optional<Algorithm> algorithm;
  std::optional<std::int64_t> max_episodes;
  std::optional<int> plateau_iterations;
  std::optional<double> plateau_min_improvement;
  std::optional<int> top_directions;
  std::optional<Schedule> step_schedule;
  std::optional<Schedule> exploration_schedule;
  std::optional<bool> log_gains;
  std::optional<int> population;
  std::optional<double> initial_sigma;
  std::optional<int> cma_es_restarts;
  std::optional<double> population_growth;
  std::optional<double> initial_step;
  std::optional<int> nelder_mead_restarts;

  void ApplyTo(SearchOptions& options) const;
  // Whether it is given; field: as SearchOptions::Validate names it, "initial_gains.k1" too.
  bool Sets(std::string_view field) const;
};

struct NewJob {
  std::string display_name;
  std::map<std::string, std::string> labels;
  ScenarioChoice scenario;
  OrbitState initial_condition;                // std::monostate: the scenario's chaser
  std::vector<OrbitState> initial_conditions;  // instead, for robust tuning
  Objective objective;
  std::string warm_start;   // jobs/ID or gainSets/ID; empty: none
  std::string campaign_id;  // of the campaign that creates it; no client's to give
  std::string owner;        // the caller's name; no client's to give
  std::string peer;         // the caller's address, where it has no name; likewise
  int priority = 0;
  SearchOverrides search;
};

struct EpisodeRequest {
  ScenarioChoice scenario;
  OrbitState initial_condition;
  std::optional<Gains> gains;  // the scenario's initial gains
  bool early_exit = false;
  bool include_trajectory = false;
  int sample_stride = 0;  // 0: 1
};

struct EpisodeAnswer {
  PreparedScenario prepared;
  EpisodeReport report;
  std::vector<EpisodeSample> trajectory;  // every sample_stride-th
};

inline constexpr std::size_t kLongestRequestId = 128;
inline constexpr std::size_t kMostStarts = 1000;  // of one job

// The preset, or the definition, valid. INVALID_ARGUMENT.
absl::StatusOr<Scenario> ChooseScenario(const ScenarioChoice& choice);

// For a new resource: twelve letters and digits at random.
std::string NewId();

template <typename T>
struct Page {
  std::vector<T> items;
  std::string next_page_token;  // empty: that was all
};

// Thread-safe. Calls that write wait until what they say is on disk; none must be made where blocking is not allowed.
// All errors: INVALID_ARGUMENT with field violations, NOT_FOUND, and what the store and the scheduler say.
class UseCases {
 public:
  // All outlive this.
  UseCases(JobStore& store, Scheduler& scheduler, EventHub& hub) : store_(store), scheduler_(scheduler), hub_(hub) {}

  // Where warm starts from gainSets/ID find them; to be called before any other thread calls.
  void set_gain_sets(GainSetSource gain_sets) { gain_sets_ = std::move(gain_sets); }

  // The spec that CreateJob would store.
  absl::StatusOr<JobSpec> ResolveJob(const NewJob& job);

  absl::StatusOr<JobRecord> CreateJob(const NewJob& job, const std::string& request_id, bool validate_only);
  absl::StatusOr<JobRecord> GetJob(const std::string& id);
  absl::StatusOr<Page<JobRecord>> ListJobs(int page_size, const std::string& page_token, const std::string& filter,
                                           const std::string& order_by);
  absl::StatusOr<JobRecord> PauseJob(const std::string& id, const std::string& etag);
  absl::StatusOr<JobRecord> ResumeJob(const std::string& id, const std::string& etag);
  absl::StatusOr<JobRecord> CancelJob(const std::string& id, const std::string& etag);
  absl::Status DeleteJob(const std::string& id, const std::string& etag);
  absl::StatusOr<Page<IterationRecord>> ListIterations(const std::string& id, int page_size,
                                                       const std::string& page_token);
  // At most `max_points` of the iterations from `first` (0: the first) to `last` (0: the newest), as
  // JobStore::SampleIterations picks them; max_points in [16, 10000].
  absl::StatusOr<Page<IterationRecord>> SampleIterations(const std::string& id, int max_points, int first = 0,
                                                         int last = 0);
  absl::StatusOr<Page<Scenario>> ListScenarios(int page_size, const std::string& page_token);
  absl::StatusOr<Scenario> GetScenario(const std::string& id);
  // cancelled: asked now and then; once true, the answer is CANCELLED.
  absl::StatusOr<EpisodeAnswer> SimulateEpisode(const EpisodeRequest& request,
                                                const std::function<bool()>& cancelled = {});

  // For watchers: events as the hub and the store have them.
  EventHub& hub() { return hub_; }
  const JobStore& store() const { return store_; }

 private:
  using Transition = void (Scheduler::*)(const std::string&, const std::string&, Scheduler::Done);
  absl::Status CheckAlone(const std::string& id, std::string_view action) const;
  absl::StatusOr<JobRecord> Await(Transition transition, const std::string& id, const std::string& etag);

  JobStore& store_;
  Scheduler& scheduler_;
  EventHub& hub_;
  GainSetSource gain_sets_;
};

}  // namespace orbitune
