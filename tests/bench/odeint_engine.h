// The rival: Boost.odeint's controlled Dormand-Prince 5(4), scalar, over the full horizon, as one would write it with
// care for speed: one fused right-hand side, no allocation in it, every sample hit, the step size kept across samples.
#pragma once

#include "core/sim/episode.h"

namespace orbitune::bench {

// Hc, fuel sum, cost and the number of steps; continuous control only. Its absolute tolerance is the problem's times
// `floor` settling distances.
EpisodeResult SimulateWithOdeint(const EpisodeProblem& problem, const Gains& gains, double floor);

}  // namespace orbitune::bench
