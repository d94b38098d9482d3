// The seam between a search over gains and whatever runs its episodes.
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "core/sim/episode.h"

namespace orbitune {

// Simulates one episode for each gains[j] and writes results[j]; the spans are of equal length. How the batch is split,
// and over how many threads, must not show in the results.
using Evaluate = std::function<void(std::span<const Gains> gains, std::span<EpisodeResult> results)>;

// What one iteration leaves behind: K(i), the episode under it, and what the update after it saw. K(i) is the iterate
// of ARS; of CMA-ES and Nelder-Mead, the best of the iteration's batch, and their "pairs" are candidates. Over several
// initial conditions (ensemble_search.h) the episode is AggregateResults' (objective.h).
struct IterationRecord {
  int iteration = 0;  // 1..M
  Gains gains{};
  Outcome outcome = Outcome::kNumericalFailure;
  double cost = kUnset;  // J(K(i)); NaN unless HasCost(outcome)
  int settling_samples = 0;
  double fuel_sum = kUnset;
  double cost_std = 0;        // sigma_J, population form, over the pairs used; of ARS: 0: no step was taken
  int pairs_left_out = 0;     // an episode of the pair left the domain or failed
  int pairs_not_settled = 0;  // used, though an episode of the pair did not settle within the horizon
  std::int64_t episodes = 0;  // flown by the search up to and with this iteration
};

// The episode under the record's K.
void SetEpisode(const EpisodeResult& result, IterationRecord& record);

// Same bits in every field; NaN equals NaN.
bool Identical(const IterationRecord& a, const IterationRecord& b);

// Settled before not settled before the rest, then by cost: the order in which a "best" is kept.
bool Better(const IterationRecord& a, const IterationRecord& b);
bool BetterResult(const EpisodeResult& a, const EpisodeResult& b);

}  // namespace orbitune
