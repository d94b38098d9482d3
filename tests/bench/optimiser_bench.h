// The optimisers at equal episodes, over initial conditions drawn from each scenario's distribution.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace orbitune::bench {

struct OptimiserBenchOptions {
  int initial_conditions = 20;
  std::int64_t budget = 6000;  // episodes for each initial condition
  std::uint64_t seed = 1;      // of the initial conditions, and of the searches
  int threads = 1;
};

// The best cost so far after so many episodes, as a reduction of J(K(1)) in percent over the initial conditions.
struct OptimiserRow {
  std::string scenario;
  std::string optimiser;
  std::int64_t episodes = 0;
  double mean_percent = 0;
  double min_percent = 0;
  double max_percent = 0;
  double mean_cost = 0;
  double seconds = 0;  // for one initial condition on one thread, to the end of the budget
};

std::vector<OptimiserRow> CompareOptimisers(const OptimiserBenchOptions& options);

}  // namespace orbitune::bench
