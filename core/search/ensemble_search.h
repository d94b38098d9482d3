// A search whose every K is flown from each of several initial conditions (robust tuning); with one of them and no
// objective, the search itself.
#pragma once

#include <memory>
#include <vector>

#include "core/search/objective.h"
#include "core/search/optimiser.h"

namespace orbitune {

// Not thread-safe. Driven as an Optimiser is, over episodes instead of gains.
class EnsembleSearch {
 public:
  // options, objective valid; max_episodes counts episodes: a K costs one for each initial condition, of which there
  // must be some. With one of them the objective has to be the cost itself, unless relative_to_initial.
  EnsembleSearch(const SearchOptions& options, const Objective& objective, std::size_t initial_conditions);

  bool done() const { return search_->done(); }
  int iteration() const { return search_->iteration(); }

  // Episode e flies gains(e) from initial condition initial_condition(e).
  std::size_t episodes() const { return search_->batch().size() * initial_conditions_; }
  const Gains& gains(std::size_t e) const { return search_->batch()[e / initial_conditions_]; }
  std::size_t initial_condition(std::size_t e) const { return e % initial_conditions_; }

  // Of episode 0, as Optimiser's.
  bool first_is_for_the_record() const {
    return initial_conditions_ == 1 && !objective_.relative_to_initial && search_->first_is_for_the_record();
  }

  // Whether no iteration's checkpoint tells anything: Resume needs but the record, at whatever iteration.
  bool needs_no_checkpoint() const { return !objective_.relative_to_initial && search_->checkpoint().empty(); }

  // As Optimiser's. FAILED_PRECONDITION also if a cost relative to J(K(1)) is asked for and K(1) has none, or 0.
  absl::StatusOr<IterationRecord> Update(std::span<const EpisodeResult> results);
  std::vector<double> checkpoint() const;
  absl::Status Resume(const IterationRecord& last, std::span<const double> checkpoint);

 private:
  absl::Status TakeBaselines(std::span<const EpisodeResult> results);

  const Objective objective_;
  const std::size_t initial_conditions_;
  std::unique_ptr<Optimiser> search_;
  std::vector<double> baselines_;  // J(K(1)) of each; empty before iteration 1 is over, and where nothing is relative
};

// OK unless max_episodes is too few for the first two batches over so many initial conditions: INVALID_ARGUMENT for
// "max_episodes".
absl::Status CheckBudget(const SearchOptions& options, std::size_t initial_conditions);

}  // namespace orbitune
