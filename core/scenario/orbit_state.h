// An orbit as a user states it: one of three forms, in km, km/s and degrees, kept exactly as it was given.
#pragma once

#include <variant>

#include "core/orbit/elements.h"

namespace orbitune {

struct KeplerianState {
  double semi_major_axis_km = 0;
  double eccentricity = 0;
  double inclination_deg = 0;
  double raan_deg = 0;
  double argument_of_periapsis_deg = 0;
  enum class Position { kTrueAnomaly, kTrueLongitude } position = Position::kTrueAnomaly;
  double position_deg = 0;
};

struct EquinoctialState {
  double p_km = 0;
  double ex = 0;
  double ey = 0;
  double hx = 0;
  double hy = 0;
  double true_longitude_deg = 0;
};

struct CartesianStateKm {
  double x_km = 0;
  double y_km = 0;
  double z_km = 0;
  double x_dot_km_s = 0;
  double y_dot_km_s = 0;
  double z_dot_km_s = 0;
};

// std::monostate: not given.
using OrbitState = std::variant<std::monostate, KeplerianState, EquinoctialState, CartesianStateKm>;

// In km and rad. INVALID_ARGUMENT naming the field (as it is called above) where the orbit is missing, not finite,
// singular or not an ellipse.
absl::StatusOr<EquinoctialElements> Resolve(const OrbitState& state, double mu_km3_s2);

}  // namespace orbitune
