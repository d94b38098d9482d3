// Batches of episodes at the speed of the hardware: core/sim's problems through the lane kernel.
#pragma once

#include <span>

#include "core/sim/episode.h"

namespace orbitune {

// One episode of a batch; the problem may be another one for each.
struct BatchEpisode {
  const EpisodeProblem* problem = nullptr;
  Gains gains{};
  bool early_exit = true;
};

// Simulates episodes[i] into results[i] on the calling thread; spans of equal length. Agrees with SimulateEpisode to
// the integration's tolerance, and with itself to the bit (core/simd/lane_kernel.h): Hc, the fuel sum and J do not
// depend on the batch. A problem with a zero-order hold goes to the scalar simulator. No effort, no trajectories: those
// are the scalar simulator's.
void SimulateBatch(std::span<const BatchEpisode> episodes, std::span<EpisodeResult> results);

}  // namespace orbitune
