#include "core/search/ensemble_search.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"

namespace orbitune {
namespace {

// The options of the search over K, each of which costs an episode for each initial condition.
SearchOptions PerInitialCondition(SearchOptions options, std::size_t initial_conditions) {
  options.max_episodes /= static_cast<std::int64_t>(initial_conditions);
  return options;
}

}  // namespace

EnsembleSearch::EnsembleSearch(const SearchOptions& options, const Objective& objective, std::size_t initial_conditions)
    : objective_(objective),
      initial_conditions_(initial_conditions),
      search_(MakeOptimiser(PerInitialCondition(options, initial_conditions))) {
  ORBITUNE_CHECK(initial_conditions > 0);
}

// The first of the batch's gains are K(1).
absl::Status EnsembleSearch::TakeBaselines(std::span<const EpisodeResult> results) {
  std::vector<double> baselines;
  for (std::size_t i = 0; i < initial_conditions_; ++i) {
    if (!HasCost(results[i].outcome) || !(results[i].cost > 0)) {
      return absl::FailedPreconditionError(
          absl::StrCat("the objective is relative to J(K(1)), but under K(1) initial condition ", i,
                       HasCost(results[i].outcome) ? " costs nothing" : " leaves the domain or fails"));
    }
    baselines.push_back(results[i].cost);
  }
  baselines_ = std::move(baselines);
  return absl::OkStatus();
}

absl::StatusOr<IterationRecord> EnsembleSearch::Update(std::span<const EpisodeResult> results) {
  ORBITUNE_CHECK(results.size() == episodes());
  if (initial_conditions_ == 1 && !objective_.relative_to_initial) return search_->Update(results);
  if (objective_.relative_to_initial && iteration() == 1) {
    if (absl::Status status = TakeBaselines(results); !status.ok()) return status;
  }
  std::vector<EpisodeResult> aggregated;
  for (std::size_t e = 0; e < results.size(); e += initial_conditions_) {
    aggregated.push_back(AggregateResults(objective_, results.subspan(e, initial_conditions_), baselines_));
  }
  absl::StatusOr<IterationRecord> record = search_->Update(aggregated);
  if (record.ok()) record->episodes *= static_cast<std::int64_t>(initial_conditions_);
  return record;
}

std::vector<double> EnsembleSearch::checkpoint() const {
  std::vector<double> state = baselines_;
  const std::vector<double> own = search_->checkpoint();
  state.insert(state.end(), own.begin(), own.end());
  return state;
}

absl::Status EnsembleSearch::Resume(const IterationRecord& last, std::span<const double> checkpoint) {
  const std::size_t baselines = objective_.relative_to_initial && last.iteration > 1 ? initial_conditions_ : 0;
  if (checkpoint.size() < baselines) return absl::DataLossError("the checkpoint is not one of this search");
  baselines_.assign(checkpoint.begin(), checkpoint.begin() + static_cast<std::ptrdiff_t>(baselines));
  IterationRecord of_gains = last;
  of_gains.episodes /= static_cast<std::int64_t>(initial_conditions_);
  return search_->Resume(of_gains, checkpoint.subspan(baselines));
}

absl::Status CheckBudget(const SearchOptions& options, std::size_t initial_conditions) {
  if (options.max_episodes == 0) return absl::OkStatus();
  std::int64_t gains = 0;
  switch (options.algorithm) {
    case Algorithm::kArs:
      gains = 2 * options.directions + 1;
      break;
    case Algorithm::kCmaEs:
      gains = 1 + options.cma_es.population;
      break;
    case Algorithm::kNelderMead:
      gains = 1 + kGainCount + 4;
      break;
  }
  const std::int64_t least = gains * static_cast<std::int64_t>(initial_conditions);
  if (options.max_episodes >= least) return absl::OkStatus();
  FieldErrors errors;
  errors.Add("max_episodes", absl::StrCat("at least ", least, ", the first batches of the search, or 0"),
             absl::StrCat(options.max_episodes));
  return errors.ToStatus();
}

}  // namespace orbitune
