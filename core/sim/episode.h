// One closed-loop episode: what goes in, what comes out. Canonical units of the target orbit (core/orbit/target.h).
#pragma once

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "core/control/control_law.h"

namespace orbitune {

inline constexpr double kDefaultIntegrationTolerance = 7e-7;
// Attempts at a step before an episode counts as a numerical failure: far more than any tolerance allowed needs, but an
// end.
constexpr int MaxStepAttempts(int horizon_samples) { return 200'000 + 300 * horizon_samples; }

enum class ControlHold { kContinuous, kZeroOrder };

struct EpisodeProblem {
  TargetOrbit target;
  ErrorState initial_error;
  GainUnits gain_units;
  double sampling_period = 0;    // Ts
  int horizon_samples = 0;       // H
  double fuel_weight = 0;        // rho
  double settling_distance = 0;  // epsilon, in units of p_r
  ControlHold hold = ControlHold::kContinuous;
  double tolerance = kDefaultIntegrationTolerance;  // see docs/model.md, "Integration"
};

enum class Outcome {
  kSettled,
  kNotSettled,  // within the horizon: Hc = H, J as the formula gives it
  kLeftDomain,  // reached x2 = -1 or a = 0: the model ends there, and with it the cost
  kNumericalFailure,
};

// True where J is defined.
inline bool HasCost(Outcome outcome) { return outcome == Outcome::kSettled || outcome == Outcome::kNotSettled; }

inline constexpr double kUnset = std::numeric_limits<double>::quiet_NaN();

struct EpisodeResult {
  Outcome outcome = Outcome::kNumericalFailure;
  int settling_samples = 0;  // Hc
  double fuel_sum = kUnset;  // sum of ||u(k)||, k < Hc, in the scenario's acceleration unit
  double cost = kUnset;      // J = Hc + rho * fuel_sum; NaN unless HasCost(outcome)
  double end_time = 0;       // simulated time reached
  double initial_lyapunov = kUnset;
  // With EpisodeOptions::measure_effort only; velocities and accelerations, canonical.
  double delta_v_to_settling = kUnset;  // integral of ||u|| dt up to Hc Ts
  double delta_v_horizon = kUnset;      // over the horizon; NaN where the episode ended before it
  double peak_acceleration = kUnset;    // the largest ||u|| at any step of the integrator
  // Of the integrator.
  int steps = 0;
  int rejected_steps = 0;
  // Where the outcome is kLeftDomain or kNumericalFailure: 1 + x2 and a at the end.
  double momentum_ratio = kUnset;
  double inverse_radius = kUnset;
};

// What an episode passes at sample k.
struct EpisodeSample {
  int sample = 0;
  double target_longitude = 0;
  ErrorState error;
  Control control;  // canonical
  double lyapunov = 0;
  double distance = 0;  // y, in units of p_r
};

struct EpisodeOptions {
  // Stop as soon as the Lyapunov function proves that the episode has settled: the same Hc, fuel sum and cost, sooner.
  // Has no effect with a zero-order hold, for which nothing is proved.
  bool early_exit = true;
  bool measure_effort = false;
  std::vector<EpisodeSample>* trajectory = nullptr;  // appended to, not owned
  // Asked at every sample and every few milliseconds; true ends the episode as a numerical failure, for a caller that
  // wants no answer any more.
  std::function<bool()> cancelled;
};

}  // namespace orbitune
