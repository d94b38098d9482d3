// The elements of an orbit by the names that digests, files and the API have for them.
#pragma once

#include <variant>

#include "core/scenario/orbit_state.h"

namespace orbitune {

// Calls add(form, name, value) for each element, in their order: "keplerian", "eccentricity", 0.73. Not at all where
// there is no orbit.
template <typename Add>
void ForEachElement(const std::monostate&, Add) {}

template <typename Add>
void ForEachElement(const KeplerianState& s, Add add) {
  constexpr const char* kForm = "keplerian";
  add(kForm, "semi_major_axis_km", s.semi_major_axis_km);
  add(kForm, "eccentricity", s.eccentricity);
  add(kForm, "inclination_deg", s.inclination_deg);
  add(kForm, "raan_deg", s.raan_deg);
  add(kForm, "argument_of_periapsis_deg", s.argument_of_periapsis_deg);
  const bool anomaly = s.position == KeplerianState::Position::kTrueAnomaly;
  add(kForm, anomaly ? "true_anomaly_deg" : "true_longitude_deg", s.position_deg);
}

template <typename Add>
void ForEachElement(const EquinoctialState& s, Add add) {
  constexpr const char* kForm = "equinoctial";
  add(kForm, "p_km", s.p_km);
  add(kForm, "ex", s.ex);
  add(kForm, "ey", s.ey);
  add(kForm, "hx", s.hx);
  add(kForm, "hy", s.hy);
  add(kForm, "true_longitude_deg", s.true_longitude_deg);
}

template <typename Add>
void ForEachElement(const CartesianStateKm& s, Add add) {
  constexpr const char* kForm = "cartesian";
  add(kForm, "x_km", s.x_km);
  add(kForm, "y_km", s.y_km);
  add(kForm, "z_km", s.z_km);
  add(kForm, "x_dot_km_s", s.x_dot_km_s);
  add(kForm, "y_dot_km_s", s.y_dot_km_s);
  add(kForm, "z_dot_km_s", s.z_dot_km_s);
}

template <typename Add>
void ForEachElement(const OrbitState& state, Add add) {
  std::visit([&add](const auto& s) { ForEachElement(s, add); }, state);
}

}  // namespace orbitune
