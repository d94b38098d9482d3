// The readable specification of an episode: Dormand-Prince 5(4), one episode at a time, every sample hit exactly.
#pragma once

#include "core/sim/episode.h"

namespace orbitune {

// gains > 0, in the problem's gain units; problem as MakeProblem gives it (core/scenario/scenario.h). Never throws;
// every way an episode can end is an Outcome. The result is a function of the arguments alone, and the cost's terms
// do not depend on the options.
EpisodeResult SimulateEpisode(const EpisodeProblem& problem, const Gains& gains, const EpisodeOptions& options = {});

}  // namespace orbitune
