// Batches of episodes at the speed of the hardware: core/sim's problems through the lane kernel.
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "core/sim/episode.h"

namespace orbitune {

// One episode of a batch; the problem may be another one for each.
struct BatchEpisode {
  const EpisodeProblem* problem = nullptr;
  Gains gains{};
  bool early_exit = true;
};

// What a batch came to, in attempts of a step.
struct BatchUse {
  std::int64_t lane_steps = 0;       // in all lanes
  std::int64_t used_lane_steps = 0;  // in those that had an episode to fly
  std::int64_t scalar_steps = 0;     // by the scalar simulator
  bool cancelled = false;            // the results are worth nothing

  BatchUse& operator+=(const BatchUse& other) {
    lane_steps += other.lane_steps;
    used_lane_steps += other.used_lane_steps;
    scalar_steps += other.scalar_steps;
    cancelled = cancelled || other.cancelled;
    return *this;
  }
};

// Simulates episodes[i] into results[i] on the calling thread; spans of equal length. Agrees with SimulateEpisode to
// the integration's tolerance, and with itself to the bit (core/simd/lane_kernel.h): Hc, the fuel sum and J do not
// depend on the batch. A problem with a zero-order hold goes to the scalar simulator. No effort, no trajectories: those
// are the scalar simulator's. cancelled: asked every few milliseconds; true ends the batch.
BatchUse SimulateBatch(std::span<const BatchEpisode> episodes, std::span<EpisodeResult> results,
                       const std::function<bool()>& cancelled = {});

}  // namespace orbitune
