// The closed loop as a lane kernel: many episodes side by side, one in each SIMD lane. Nothing but numbers crosses this
// border; batch_simulator.h is what the rest of the program calls.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace orbitune::simd {

// One episode, canonical units throughout (core/sim/episode.h has the meanings).
struct LaneEpisode {
  double x[6];               // initial error coordinates
  double target_longitude;   // L_r(0)
  double ex, ey, hx, hy;     // the target's
  double k[5];               // gains
  double sampling_period;    // Ts
  double horizon_samples;    // H, a whole number
  double settling_distance;  // epsilon
  double settled_below;      // c*: with V <= c* all samples to come are inside
  bool early_exit;           // stop then
  double control_unit;       // of ||u|| in the fuel sum
  double tolerance;
  double max_attempts;  // of steps
};

enum class LaneOutcome { kSettled, kNotSettled, kLeftDomain, kNumericalFailure };

struct LaneResult {
  LaneOutcome outcome;
  int settling_samples;
  double fuel_sum;
  double end_time;
  double initial_lyapunov;
  double momentum_ratio;  // 1 + x2 at the end
  double inverse_radius;  // a at the end
  int steps;
  int rejected_steps;
};

// Asked now and then whether nobody wants the results any more.
struct Interrupt {
  bool (*asked)(const void* context) = nullptr;  // nullptr: always wanted
  const void* context = nullptr;
};

// What a call made of the lanes.
struct LaneUse {
  std::int64_t lane_steps = 0;       // attempts of a step, in every lane whether it had an episode or not
  std::int64_t used_lane_steps = 0;  // in those that had one
  bool interrupted = false;          // the results are not all written
};

// Simulates n episodes on the calling thread. Each result is a function of its episode alone: not of its neighbours,
// the order, n, nor, among the targets that can fuse a multiplication and an addition, the target.
LaneUse RunLanes(const LaneEpisode* episodes, LaneResult* results, std::size_t n, const Interrupt& interrupt = {});

// How many episodes one thread keeps in flight on the target in use.
std::size_t LaneCount();

// The instruction sets that this processor can run, the best first: "avx512", "avx2", "baseline".
std::vector<std::string> SupportedTargets();

// The one in use, and the choice of another one for the whole process: "auto" or one of the supported, else false.
// To be called before any episode runs, or between batches.
std::string TargetInUse();
bool UseTarget(const std::string& name);

// Whether the one in use fuses a multiplication and an addition.
bool TargetFuses();

}  // namespace orbitune::simd
