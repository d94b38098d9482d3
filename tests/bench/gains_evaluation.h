// How good the library's answers are: gains tuned for some starts, asked for at others, against tuning those.
#pragma once

#include <cstdint>
#include <vector>

#include "core/control/gains.h"

namespace orbitune::bench {

struct EvaluationOptions {
  int tuned = 50;       // starts in the library
  int held_out = 200;   // starts asked for
  int episodes = 6000;  // of CMA-ES, for each start
  int refine_ms = 100;
  std::uint64_t seed = 1;
};

// Costs over those of a full tuning of the same held-out start, by CMA-ES.
struct EvaluationRow {
  double query_mean = 0;
  double query_worst = 0;
  double refined_mean = 0;
  double refined_worst = 0;
  double mean_gains_mean = 0;     // K-hat, the arithmetic mean of the tuned gains
  double robust_mean = 0;         // one K, tuned for the mean of J / J(K(1)) over the tuned starts
  int worse_than_mean_gains = 0;  // held-out starts whose answer costs more than K-hat
  int worse_than_robust = 0;
  int extrapolated = 0;
  double refine_episodes = 0;  // on average
};

// The gains of the first `count` tuned starts.
std::vector<Gains> TunedGains(int count, const EvaluationOptions& options);

// leo-rendezvous, its own distribution of starts.
EvaluationRow Evaluate(const EvaluationOptions& options);

}  // namespace orbitune::bench
