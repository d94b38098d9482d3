// What the benchmark flies: the same episodes for every engine.
#pragma once

#include <string>
#include <vector>

#include "core/simd/batch_simulator.h"

namespace orbitune::bench {

struct Workload {
  std::string name;  // "gto-geo/initial", ...
  EpisodeProblem problem;
  std::vector<Gains> gains;
};

// gto-geo, leo-rendezvous and an elliptic target, each with `count` gains scattered by 5 % about the scenario's K(1)
// and about tuned ones.
std::vector<Workload> MakeWorkloads(int count, double tolerance);

}  // namespace orbitune::bench
