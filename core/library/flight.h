// What flying gains from one initial condition came to, in physical units, and what is certain about it.
#pragma once

#include "core/scenario/scenario.h"

namespace orbitune {

struct Certificate {
  bool gains_positive = false;       // the stability proof asks for no more
  bool domain_guaranteed = false;    // V(0) < (1 - e_r)^2 / 2: certain to stay in the domain
  bool lyapunov_decreasing = false;  // V never rose from one sample to the next, along the trajectory flown
  bool settled = false;              // within the horizon
};

// NaN where the episode does not have the value.
struct Flight {
  Outcome outcome = Outcome::kNumericalFailure;
  std::string outcome_message;  // when and why, where the outcome is not kSettled
  double cost = kUnset;         // J
  int settling_samples = 0;
  double settling_time_s = kUnset;
  double fuel_sum = kUnset;                // in the scenario's acceleration unit
  double delta_v_m_s = kUnset;             // integral of ||u|| dt up to settling
  double peak_acceleration_m_s2 = kUnset;  // the largest ||u||, up to where the episode ended
  Certificate certificate;
};

// An episode by the scalar simulator, its effort measured and its Lyapunov function watched.
struct WatchedEpisode {
  EpisodeResult result;
  bool lyapunov_decreasing = false;
};

// As SimulateEpisode with these options; measure_effort is set, and a trajectory is appended to where one is given.
WatchedEpisode FlyWatched(const EpisodeProblem& problem, const Gains& gains, EpisodeOptions options);

// The episode in the units of the scenario that it was prepared from.
Flight ToFlight(const WatchedEpisode& episode, const PreparedScenario& prepared, const Gains& gains);

}  // namespace orbitune
