#include "core/orbit/target.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/core/testing.h"

namespace orbitune {
namespace {

TEST(CanonicalUnitsTest, MakeMuAndSemiParameterOne) {
  const double mu = 398600.4418;
  const CanonicalUnits units = CanonicalUnitsOf(mu, 42165);
  EXPECT_DOUBLE_EQ(units.length_km, 42165);
  EXPECT_NEAR(mu * units.time_s * units.time_s / std::pow(units.length_km, 3), 1, 1e-14);
  // sqrt(mu / p) and mu / p^2.
  EXPECT_NEAR(units.velocity_m_s(), 3074.62982397692, 1e-9);
  EXPECT_NEAR(units.acceleration_m_s2(), 0.672596837743744 / 3, 1e-12);
}

TEST(TargetOrbitTest, PhaseIsTheEccentricityVectorSeenFromTheTarget) {
  const double e = 0.4, periapsis = 1.3, anomaly = 2.1;
  const TargetOrbit target{.ex = e * std::cos(periapsis), .ey = e * std::sin(periapsis)};
  const TargetPhase phase = target.PhaseAt(periapsis + anomaly);
  EXPECT_NEAR(phase.zeta_x, e * std::cos(anomaly), 1e-15);
  EXPECT_NEAR(phase.zeta_y, e * std::sin(anomaly), 1e-15);
  EXPECT_NEAR(target.eccentricity(), e, 1e-15);
}

// Independent of the rate: Kepler's equation gives the anomaly reached after a given time.
TEST(TargetOrbitTest, LongitudeRateFollowsKeplersEquation) {
  testing::Random random(4);
  for (int i = 0; i < 100; ++i) {
    const double e = random.Uniform(0, 0.7), periapsis = random.Angle();
    const TargetOrbit target{.ex = e * std::cos(periapsis), .ey = e * std::sin(periapsis)};
    const double mean_motion = std::pow(1 - e * e, 1.5);  // p = 1
    const auto time_of = [&](double anomaly) {
      const double eccentric = 2 * std::atan(std::sqrt((1 - e) / (1 + e)) * std::tan(anomaly / 2));
      return (eccentric - e * std::sin(eccentric)) / mean_motion;
    };
    const double anomaly = random.Uniform(-3, 3), h = 1e-4;
    const double rate = 2 * h / (time_of(anomaly + h) - time_of(anomaly - h));
    EXPECT_NEAR(TargetOrbit::LongitudeRate(target.PhaseAt(periapsis + anomaly)) / rate, 1, 1e-6);
  }
}

}  // namespace
}  // namespace orbitune
