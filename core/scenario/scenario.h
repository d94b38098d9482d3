// A scenario: what is flown, what it costs, and the search's defaults for it (paper, section IV).
#pragma once

#include <string>

#include "core/scenario/distribution.h"
#include "core/scenario/orbit_state.h"
#include "core/search/options.h"
#include "core/sim/episode.h"

namespace orbitune {

inline constexpr double kEarthMuKm3S2 = 398600.4418;

struct Scenario {
  std::string id;  // of a preset; of a definition of one's own any text or none
  std::string display_name;
  std::string description;
  double gravitational_parameter_km3_s2 = kEarthMuKm3S2;
  OrbitState target;  // at t = 0
  OrbitState chaser;  // the default initial condition, at t = 0
  double sampling_period_s = 0;
  int horizon_samples = 0;            // H
  double fuel_weight = 0;             // rho
  double settling_distance_km = 0;    // epsilon
  double velocity_unit_m_s = 0;       // of K1; 0: sqrt(mu / p_r)
  double acceleration_unit_m_s2 = 0;  // of K2..K5 and of the control in the cost; 0: mu / p_r^2
  ControlHold control_hold = ControlHold::kContinuous;
  double integration_tolerance = kDefaultIntegrationTolerance;
  SearchOptions search;
  IcDistribution neighbourhood;  // what campaigns draw from; no part of what a job flies

  static constexpr int kMaxHorizonSamples = 100'000;
  static constexpr double kMaxFuelWeight = 1e9;

  // OK, or INVALID_ARGUMENT with every field that is missing or out of range.
  absl::Status Validate() const;
};

// A scenario with its units worked out and its search checked against nothing: what an episode needs.
struct PreparedScenario {
  EpisodeProblem problem;
  CanonicalUnits units;
  double velocity_unit_m_s = 0;       // resolved
  double acceleration_unit_m_s2 = 0;  // resolved
};

// initial_condition: std::monostate for the scenario's own chaser. INVALID_ARGUMENT as Validate's, and for the
// initial condition under the name "initial_condition".
absl::StatusOr<PreparedScenario> Prepare(const Scenario& scenario, const OrbitState& initial_condition = {});

// Where and why an episode ended before its time, in a sentence with units; empty if it did not.
std::string DescribeOutcome(const EpisodeResult& result, const PreparedScenario& prepared);

}  // namespace orbitune
