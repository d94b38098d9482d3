#include "core/simd/batch_simulator.h"

#include <algorithm>
#include <array>

#include "core/base/check.h"
#include "core/control/certificate.h"
#include "core/sim/scalar_simulator.h"
#include "core/simd/lane_kernel.h"

namespace orbitune {
namespace {

// Episodes handed to the kernel at a time, on the stack.
constexpr std::size_t kChunk = 512;

simd::LaneEpisode ToLane(const BatchEpisode& episode) {
  const EpisodeProblem& p = *episode.problem;
  const ErrorState& x = p.initial_error;
  const CanonicalGains k = ToCanonical(episode.gains, p.gain_units);
  return {.x = {x.x1, x.x2, x.x3, x.x4, x.x5, x.x6},
          .target_longitude = p.target.initial_longitude,
          .ex = p.target.ex,
          .ey = p.target.ey,
          .hx = p.target.hx,
          .hy = p.target.hy,
          .k = {k.k1, k.k2, k.k3, k.k4, k.k5},
          .sampling_period = p.sampling_period,
          .horizon_samples = static_cast<double>(p.horizon_samples),
          .settling_distance = p.settling_distance,
          .settled_below = SettlingLyapunov(p.settling_distance, p.target, k.k1),
          .early_exit = episode.early_exit,
          .control_unit = p.gain_units.acceleration,
          .tolerance = p.tolerance,
          .max_attempts = static_cast<double>(MaxStepAttempts(p.horizon_samples))};
}

Outcome FromLane(simd::LaneOutcome outcome) {
  switch (outcome) {
    case simd::LaneOutcome::kSettled:
      return Outcome::kSettled;
    case simd::LaneOutcome::kNotSettled:
      return Outcome::kNotSettled;
    case simd::LaneOutcome::kLeftDomain:
      return Outcome::kLeftDomain;
    case simd::LaneOutcome::kNumericalFailure:
      break;
  }
  return Outcome::kNumericalFailure;
}

EpisodeResult FromLane(const simd::LaneResult& lane, double fuel_weight) {
  EpisodeResult result{.outcome = FromLane(lane.outcome),
                       .end_time = lane.end_time,
                       .initial_lyapunov = lane.initial_lyapunov,
                       .steps = lane.steps,
                       .rejected_steps = lane.rejected_steps};
  if (HasCost(result.outcome)) {
    result.settling_samples = lane.settling_samples;
    result.fuel_sum = lane.fuel_sum;
    result.cost = result.settling_samples + fuel_weight * result.fuel_sum;
  } else {
    result.momentum_ratio = lane.momentum_ratio;
    result.inverse_radius = lane.inverse_radius;
  }
  return result;
}

bool InLanes(const BatchEpisode& episode) { return episode.problem->hold == ControlHold::kContinuous; }

BatchUse SimulateChunk(std::span<const BatchEpisode> episodes, std::span<EpisodeResult> results,
                       const std::function<bool()>& cancelled) {
  std::array<simd::LaneEpisode, kChunk> lanes;
  std::array<simd::LaneResult, kChunk> lane_results;
  std::size_t count = 0;
  for (const BatchEpisode& episode : episodes) {
    if (InLanes(episode)) lanes[count++] = ToLane(episode);
  }
  const auto asked = [](const void* context) { return (*static_cast<const std::function<bool()>*>(context))(); };
  const simd::LaneUse lane_use = simd::RunLanes(lanes.data(), lane_results.data(), count,
                                                cancelled ? simd::Interrupt{asked, &cancelled} : simd::Interrupt{});
  BatchUse use{.lane_steps = lane_use.lane_steps,
               .used_lane_steps = lane_use.used_lane_steps,
               .cancelled = lane_use.interrupted};
  if (use.cancelled) return use;
  count = 0;
  for (std::size_t i = 0; i < episodes.size(); ++i) {
    const BatchEpisode& episode = episodes[i];
    if (InLanes(episode)) {
      results[i] = FromLane(lane_results[count++], episode.problem->fuel_weight);
      continue;
    }
    results[i] =
        SimulateEpisode(*episode.problem, episode.gains, {.early_exit = episode.early_exit, .cancelled = cancelled});
    use.scalar_steps += results[i].steps + results[i].rejected_steps;
  }
  if (count < episodes.size()) use.cancelled = cancelled && cancelled();
  return use;
}

}  // namespace

BatchUse SimulateBatch(std::span<const BatchEpisode> episodes, std::span<EpisodeResult> results,
                       const std::function<bool()>& cancelled) {
  ORBITUNE_CHECK(episodes.size() == results.size());
  BatchUse use;
  for (std::size_t begin = 0; begin < episodes.size() && !use.cancelled; begin += kChunk) {
    const std::size_t count = std::min(kChunk, episodes.size() - begin);
    use += SimulateChunk(episodes.subspan(begin, count), results.subspan(begin, count), cancelled);
  }
  return use;
}

}  // namespace orbitune
