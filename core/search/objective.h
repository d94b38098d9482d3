// The cost of one K over several initial conditions: robust tuning.
#pragma once

#include <span>

#include "core/sim/episode.h"

namespace orbitune {

enum class Aggregate { kMean, kPercentile, kCvar, kWorst };

struct Objective {
  Aggregate aggregate = Aggregate::kMean;
  double level = 0;                  // q of kPercentile and kCvar, in (0, 1); else 0
  bool relative_to_initial = false;  // of J / J(K(1)) of each initial condition instead of J

  // OK, or INVALID_ARGUMENT for "level".
  absl::Status Validate() const;
};

// Over n costs, n > 0, in ascending order c_1 <= ... <= c_n:
//   mean        (c_1 + ... + c_n) / n, added up in the order given
//   percentile  c_k with k = ceil(q n): the least cost that a share q of them does not exceed
//   CVaR        the mean of the costliest (1 - q) n, of which the last may count in part (Rockafellar, Uryasev 2000)
//   worst       c_n
double AggregateCosts(const Objective& objective, std::span<const double> costs);

// One result that stands for those of one K over the initial conditions. Its outcome is the worst of theirs (left the
// domain, failed, not settled, settled, in this order). Where all have a cost: cost is the objective's value,
// settling_samples and fuel_sum are means. baselines: J(K(1)) of each, with relative_to_initial; else unused.
EpisodeResult AggregateResults(const Objective& objective, std::span<const EpisodeResult> results,
                               std::span<const double> baselines);

}  // namespace orbitune
