#include "core/scenario/presets.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace orbitune {
namespace {

// Gains and controls are in this multiple of mu / p_r^2: with it the paper's tables come out.
constexpr double kPaperAccelerationUnit = 3;

double AccelerationUnit(double p_km) {
  return kPaperAccelerationUnit * CanonicalUnitsOf(kEarthMuKm3S2, p_km).acceleration_m_s2();
}

Scenario GtoGeo() {
  constexpr double kGeoRadiusKm = 42165;
  Scenario s;
  s.id = "gto-geo";
  s.display_name = "GTO to GEO transfer";
  s.description =
      "The paper's scenario A: from an inclined geostationary transfer orbit to a circular equatorial GEO. "
      "The longitude of periapsis is -127 deg, the mirror image of the printed one.";
  s.target = EquinoctialState{.p_km = kGeoRadiusKm};
  s.chaser = KeplerianState{.semi_major_axis_km = 24364,
                            .eccentricity = 0.7306,
                            .inclination_deg = 63,
                            .raan_deg = 75,
                            .argument_of_periapsis_deg = 158,  // omega + Omega = 233 = -127 deg
                            .position = KeplerianState::Position::kTrueLongitude,
                            .position_deg = 30};
  s.sampling_period_s = 45 * 60;
  s.horizon_samples = 1280;
  s.fuel_weight = 50;
  s.settling_distance_km = 10;
  s.acceleration_unit_m_s2 = AccelerationUnit(kGeoRadiusKm);
  s.search.iterations = 2000;
  // Sigma_delta = diag(0.1, 1, 1, 1, 10) read as the covariance it is called.
  s.search.exploration_std = {std::sqrt(0.1), 1, 1, 1, std::sqrt(10.0)};
  constexpr UniformVariate kAnyAngle{.low = 45, .high = 90};
  s.neighbourhood = KeplerianDistribution{.semi_major_axis_km = FixedValue{24364},
                                          .eccentricity = FixedValue{0.7306},
                                          .inclination_deg = kAnyAngle,
                                          .raan_deg = kAnyAngle,
                                          .argument_of_periapsis_deg = kAnyAngle,
                                          .position = KeplerianState::Position::kTrueLongitude,
                                          .position_deg = FixedValue{30},
                                          .mirrored_periapsis = true};
  return s;
}

Scenario GtoGeoPrinted() {
  Scenario s = GtoGeo();
  s.id = "gto-geo-printed";
  s.display_name = "GTO to GEO transfer, as printed";
  s.description =
      "Scenario A with the longitude of periapsis as the paper prints it (+127 deg): the closed loop reaches zero "
      "angular momentum and leaves the domain, so that a tuning job on it fails. Kept to show exactly that.";
  std::get<KeplerianState>(s.chaser).argument_of_periapsis_deg = 52;
  std::get<KeplerianDistribution>(s.neighbourhood).mirrored_periapsis = false;
  return s;
}

Scenario LeoRendezvous() {
  constexpr double kRadiusKm = 7378.137;
  constexpr double kDegree = std::numbers::pi / 180;
  Scenario s;
  s.id = "leo-rendezvous";
  s.display_name = "LEO rendezvous";
  s.description =
      "The paper's scenario B: terminal rendezvous with a target on a circular orbit of 1000 km altitude, from a "
      "neighbourhood of some 60 km.";
  const EquinoctialState target{.p_km = kRadiusKm, .hx = std::tan(81 * kDegree / 2), .true_longitude_deg = 45};
  s.target = target;
  s.chaser = EquinoctialState{.p_km = target.p_km + 15,
                              .ex = 3e-5,
                              .ey = -2e-5,
                              .hx = target.hx + 1.5e-3,
                              .hy = -1e-3,
                              .true_longitude_deg = target.true_longitude_deg + 0.4};
  s.sampling_period_s = 3 * 60;
  s.horizon_samples = 1280;
  s.fuel_weight = 400;
  s.settling_distance_km = 1;
  s.acceleration_unit_m_s2 = AccelerationUnit(kRadiusKm);
  s.search.iterations = 5000;
  // diag(0.1, 1, 1, 1, 10) itself: with its square roots K5 is far from its optimum after 5000 iterations.
  s.search.exploration_std = {0.1, 1, 1, 1, 10};
  s.neighbourhood = EquinoctialDistribution{.p_km = NormalVariate{target.p_km, 20},
                                            .ex = NormalVariate{0, 3e-5},
                                            .ey = NormalVariate{0, 3e-5},
                                            .hx = NormalVariate{target.hx, 2e-3},
                                            .hy = NormalVariate{0, 2e-3},
                                            .true_longitude_deg = NormalVariate{target.true_longitude_deg, 0.5}};
  return s;
}

}  // namespace

std::span<const Scenario> Presets() {
  static const auto* const presets = new std::vector<Scenario>{GtoGeo(), GtoGeoPrinted(), LeoRendezvous()};
  return *presets;
}

const Scenario* FindPreset(std::string_view id) {
  const auto presets = Presets();
  const auto found = std::ranges::find(presets, id, &Scenario::id);
  return found == presets.end() ? nullptr : &*found;
}

}  // namespace orbitune
