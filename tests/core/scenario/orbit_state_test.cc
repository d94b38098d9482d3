#include "core/scenario/orbit_state.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <string>

namespace orbitune {
namespace {

constexpr double kMu = 398600.4418;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kDegree = std::numbers::pi / 180;

KeplerianState Geostationary() { return {.semi_major_axis_km = 42165, .inclination_deg = 5}; }

TEST(ResolveTest, KeplerianInDegreesByAnomalyOrLongitude) {
  const KeplerianState by_anomaly{.semi_major_axis_km = 24364,
                                  .eccentricity = 0.73,
                                  .inclination_deg = 63,
                                  .raan_deg = 75,
                                  .argument_of_periapsis_deg = 158,
                                  .position_deg = 40};
  const auto elements = Resolve(by_anomaly, kMu);
  ASSERT_TRUE(elements.ok()) << elements.status();
  EXPECT_NEAR(elements->p, 24364 * (1 - 0.73 * 0.73), 1e-9);
  EXPECT_NEAR(elements->ex, 0.73 * std::cos(233 * kDegree), 1e-15);
  EXPECT_NEAR(elements->ey, 0.73 * std::sin(233 * kDegree), 1e-15);
  EXPECT_NEAR(elements->hx, std::tan(31.5 * kDegree) * std::cos(75 * kDegree), 1e-15);
  EXPECT_NEAR(elements->hy, std::tan(31.5 * kDegree) * std::sin(75 * kDegree), 1e-15);
  EXPECT_NEAR(elements->true_longitude, 273 * kDegree, 1e-14);

  KeplerianState by_longitude = by_anomaly;
  by_longitude.position = KeplerianState::Position::kTrueLongitude;
  EXPECT_NEAR(Resolve(by_longitude, kMu)->true_longitude, 40 * kDegree, 1e-14);
}

TEST(ResolveTest, EquinoctialAsItIs) {
  const auto elements = Resolve(
      EquinoctialState{.p_km = 7000, .ex = 0.1, .ey = 0.2, .hx = 0.3, .hy = -0.4, .true_longitude_deg = 90}, kMu);
  ASSERT_TRUE(elements.ok());
  EXPECT_EQ(elements->p, 7000);
  EXPECT_EQ(elements->ex, 0.1);
  EXPECT_EQ(elements->ey, 0.2);
  EXPECT_EQ(elements->hx, 0.3);
  EXPECT_EQ(elements->hy, -0.4);
  EXPECT_NEAR(elements->true_longitude, std::numbers::pi / 2, 1e-15);
}

TEST(ResolveTest, CartesianCircularOrbit) {
  const auto elements = Resolve(CartesianStateKm{.y_km = 7000, .x_dot_km_s = -std::sqrt(kMu / 7000)}, kMu);
  ASSERT_TRUE(elements.ok()) << elements.status();
  EXPECT_NEAR(elements->p, 7000, 1e-9);
  EXPECT_NEAR(elements->eccentricity(), 0, 1e-14);
  EXPECT_NEAR(elements->true_longitude, std::numbers::pi / 2, 1e-14);
}

void ExpectRefused(const OrbitState& state, std::string_view field, std::string_view description) {
  const auto violations = FieldViolationsOf(Resolve(state, kMu).status());
  ASSERT_EQ(violations.size(), 1u) << Resolve(state, kMu).status();
  EXPECT_EQ(violations[0].field, field);
  EXPECT_EQ(violations[0].description.substr(0, description.size()), description);
}

TEST(ResolveTest, ErrorsNameTheFieldAsTheUserKnowsIt) {
  ExpectRefused(std::monostate(), "form", "must be one of keplerian, equinoctial, cartesian, got none");

  KeplerianState k = Geostationary();
  k.semi_major_axis_km = 0;
  ExpectRefused(k, "keplerian.semi_major_axis_km", "must be > 0 and finite, got 0");
  k = Geostationary();
  k.eccentricity = 1.2;
  ExpectRefused(k, "keplerian.eccentricity", "must be in [0, 1), an ellipse, got 1.2");
  k = Geostationary();
  k.inclination_deg = 180;
  ExpectRefused(k, "keplerian.inclination_deg", "must be in [0, 180)");
  k = Geostationary();
  k.raan_deg = kNan;
  ExpectRefused(k, "keplerian.raan_deg", "must be a finite number in [-1e+06, 1e+06], got nan");
  k = Geostationary();
  k.position_deg = kNan;
  ExpectRefused(k, "keplerian.true_anomaly_deg", "must be a finite number");
  k.position = KeplerianState::Position::kTrueLongitude;
  ExpectRefused(k, "keplerian.true_longitude_deg", "must be a finite number");

  ExpectRefused(EquinoctialState{.p_km = -7000}, "equinoctial.p_km", "must be > 0 and finite, got -7000");
  ExpectRefused(EquinoctialState{.p_km = 7000, .ex = 0.8, .ey = 0.6}, "equinoctial.ex", "must be such that sqrt");
  ExpectRefused(EquinoctialState{.p_km = 7000, .hx = kNan}, "equinoctial.hx", "must be a finite number");

  ExpectRefused(CartesianStateKm{.x_km = kNan, .y_dot_km_s = 7}, "cartesian.x_km", "must be a finite number");
  ExpectRefused(CartesianStateKm{.x_km = 7000, .x_dot_km_s = 7}, "cartesian", "its velocity must be not parallel");
  ExpectRefused(CartesianStateKm{.x_km = 7000, .y_dot_km_s = -7}, "cartesian", "its inclination must be < 180 deg");
  ExpectRefused(CartesianStateKm{.x_km = 7000, .y_dot_km_s = 12}, "cartesian", "its eccentricity must be < 1");
}

// Just below the singularity there is still an orbit, and its form goes through.
TEST(ResolveTest, AlmostRetrogradeIsFine) {
  KeplerianState k = Geostationary();
  k.inclination_deg = 179.9;
  EXPECT_TRUE(Resolve(k, kMu).ok());
}

}  // namespace
}  // namespace orbitune
