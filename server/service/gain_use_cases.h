// The use cases of the gain library, in domain types, once for every transport. Validation lives here.
#pragma once

#include <chrono>
#include <functional>

#include "core/library/query.h"
#include "server/service/use_cases.h"

namespace orbitune {

struct GainQuery {
  ScenarioChoice scenario;
  OrbitState initial_condition;         // std::monostate: the scenario's chaser
  int max_candidates = 0;               // 0: 64
  int max_answers = 0;                  // 0: 5
  std::optional<int> refine_budget_ms;  // none: no refinement; 0: 100
};

struct GainQueryAnswer {
  QueryResult result;
  std::string message;  // what to know about it, and what to do where it is not good
  std::string scenario_digest;
  PreparedScenario prepared;
};

// As a file has it; what is empty, or none, is not known.
struct ImportedGainSet {
  ScenarioChoice scenario;
  std::string scenario_digest;
  std::optional<double> velocity_unit_m_s;
  std::optional<double> acceleration_unit_m_s2;
  std::string display_name;
  Gains gains{};
  OrbitState initial_condition;
  int iteration = 0;
  std::string algorithm;
  std::uint64_t seed = 0;
  std::string engine_version;
  std::string history_digest;
  std::string origin;
};

struct GainSetImport {
  std::vector<GainSet> sets;  // in the order of the request
  int imported = 0;           // of them; the others were there
};

// Thread-safe. Calls that write wait until what they say is on disk; Query computes and reads no disk. All errors:
// INVALID_ARGUMENT with field violations, NOT_FOUND, and what the store says.
class GainUseCases {
 public:
  static constexpr int kMostImported = 10'000;
  static constexpr int kDefaultRefineMs = 100;
  static constexpr int kMostRefineMs = 10'000;

  // Both outlive this; the library has what the store has.
  GainUseCases(JobStore& store, GainLibrary& library) : store_(store), library_(library) {}

  // cancelled: asked every few milliseconds; once true, the answer is CANCELLED.
  absl::StatusOr<GainQueryAnswer> Query(const GainQuery& query, const std::function<bool()>& cancelled = {});

  absl::StatusOr<GainSet> Get(const std::string& id);
  // As a job's K(1).
  absl::StatusOr<WarmStart> WarmStartFrom(const std::string& id);
  absl::StatusOr<Page<GainSet>> List(int page_size, const std::string& page_token, const std::string& filter);
  absl::Status Delete(const std::string& id);

  // All or none. Each is flown from its own start first; what is stored is what came of that.
  absl::StatusOr<GainSetImport> Import(const std::vector<ImportedGainSet>& sets, bool validate_only,
                                       const std::function<bool()>& cancelled = {});

 private:
  std::string Advice(const Scenario& scenario, const GainQueryAnswer& answer) const;
  std::string SimilarScenarios(const Scenario& scenario, const std::string& digest) const;
  absl::StatusOr<std::optional<GainSet>> FindSame(const GainSet& set) const;
  absl::Status Store(const std::vector<GainSet>& sets);

  JobStore& store_;
  GainLibrary& library_;
};

}  // namespace orbitune
