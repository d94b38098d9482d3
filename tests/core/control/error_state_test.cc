#include "core/control/error_state.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "tests/core/testing.h"

namespace orbitune {
namespace {

using testing::Random;
using testing::RandomState;
using testing::RandomTarget;

constexpr int kStates = 5000;

EquinoctialElements ElementsOf(const TargetOrbit& target, double longitude) {
  return {.true_longitude = longitude, .p = 1, .ex = target.ex, .ey = target.ey, .hx = target.hx, .hy = target.hy};
}

double LargestDifference(const ErrorState& a, const ErrorState& b) {
  return std::max({std::abs(a.x1 - b.x1), std::abs(a.x2 - b.x2), std::abs(a.x3 - b.x3), std::abs(a.x4 - b.x4),
                   std::abs(a.x5 - b.x5), std::abs(a.x6 - b.x6)});
}

double LargestDifference(const EquinoctialElements& a, const EquinoctialElements& b) {
  return std::max({std::abs(a.true_longitude - b.true_longitude), std::abs(a.p - b.p), std::abs(a.ex - b.ex),
                   std::abs(a.ey - b.ey), std::abs(a.hx - b.hx), std::abs(a.hy - b.hy)});
}

TEST(ErrorStateTest, VanishesOnTheTargetAndOnlyThere) {
  Random random(1);
  for (int i = 0; i < kStates; ++i) {
    const TargetOrbit target = RandomTarget(random, 0.7);
    const double longitude = random.Uniform(-20, 20);
    const EquinoctialElements own = ElementsOf(target, longitude);
    const ErrorState zero = ErrorBetween(own, target, longitude);
    ASSERT_EQ(LargestDifference(zero, {}), 0);
    ASSERT_LT(LargestDifference(ChaserElements({}, target, longitude), own), 1e-15);
    ASSERT_EQ(Distance({}, target, target.PhaseAt(longitude)), 0);

    // Any one element a little off shows.
    for (double EquinoctialElements::*field :
         {&EquinoctialElements::true_longitude, &EquinoctialElements::p, &EquinoctialElements::ex,
          &EquinoctialElements::ey, &EquinoctialElements::hx, &EquinoctialElements::hy}) {
      EquinoctialElements off = own;
      off.*field += 1e-6;
      ASSERT_GT(LargestDifference(ErrorBetween(off, target, longitude), {}), 1e-7);
    }
  }
}

TEST(ErrorStateTest, RoundTripFromElements) {
  Random random(2);
  for (int i = 0; i < kStates; ++i) {
    const TargetOrbit target = RandomTarget(random, 0.7);
    const TargetOrbit chaser = RandomTarget(random, 0.95);
    EquinoctialElements elements = ElementsOf(chaser, random.Uniform(-20, 20));
    elements.p = random.LogUniform(0.05, 20);
    const double longitude = random.Uniform(-20, 20);
    const ErrorState x = ErrorBetween(elements, target, longitude);
    ASSERT_TRUE(InDomain(x, target.PhaseAt(longitude)));
    ASSERT_LT(LargestDifference(ChaserElements(x, target, longitude), elements), 1e-13 * elements.p + 1e-14);
  }
}

TEST(ErrorStateTest, RoundTripFromErrors) {
  Random random(3);
  for (int i = 0; i < kStates; ++i) {
    const TargetOrbit target = RandomTarget(random, 0.7);
    const double longitude = random.Angle();
    const ErrorState x = RandomState(random, target.PhaseAt(longitude));
    ASSERT_LT(LargestDifference(ErrorBetween(ChaserElements(x, target, longitude), target, longitude), x), 1e-13);
  }
}

TEST(ErrorStateTest, MeansWhatItsHeaderSays) {
  Random random(4);
  for (int i = 0; i < kStates; ++i) {
    const TargetOrbit target = RandomTarget(random, 0.7);
    const double longitude = random.Angle();
    const TargetPhase phase = target.PhaseAt(longitude);
    const TargetOrbit orbit = RandomTarget(random, 0.9);
    EquinoctialElements chaser = ElementsOf(orbit, random.Angle());
    chaser.p = random.LogUniform(0.1, 10);
    const ErrorState x = ErrorBetween(chaser, target, longitude);
    const CartesianState own = *ToCartesian(chaser, 1);
    const CartesianState reference = *ToCartesian(ElementsOf(target, longitude), 1);

    ASSERT_NEAR(1 + x.x2, own.position.cross(own.velocity).norm() / reference.position.cross(reference.velocity).norm(),
                1e-13 * (1 + x.x2));
    ASSERT_NEAR(InverseRadius(x, phase) * own.position.norm(), 1, 1e-13);
    const double distance = (own.position - reference.position).norm();
    ASSERT_NEAR(Distance(x, target, phase), distance, 1e-13 * (own.position.norm() + reference.position.norm()));
    // e sin(nu) / sqrt(p) is a radial velocity.
    const double radial_velocity = own.position.dot(own.velocity) / own.position.norm();
    const double reference_velocity = reference.position.dot(reference.velocity) / reference.position.norm();
    ASSERT_NEAR(x.x4, radial_velocity - reference_velocity, 1e-13 * own.velocity.norm() + 1e-14);
  }
}

// A whole turn ahead is the same place.
TEST(ErrorStateTest, DistanceIsPeriodicInTheLongitude) {
  Random random(5);
  const TargetOrbit target = RandomTarget(random, 0.5);
  const TargetPhase phase = target.PhaseAt(0.3);
  ErrorState x = RandomState(random, phase);
  const double distance = Distance(x, target, phase);
  x.x1 += 4 * 3.14159265358979323846;
  EXPECT_NEAR(Distance(x, target, phase), distance, 1e-13);
}

TEST(ErrorStateTest, DomainEndsWhereMomentumOrInverseRadiusVanish) {
  const TargetPhase phase{.zeta_x = -0.25};
  EXPECT_TRUE(InDomain({.x2 = -0.999, .x3 = -0.749}, phase));
  EXPECT_FALSE(InDomain({.x2 = -1}, phase));
  EXPECT_FALSE(InDomain({.x3 = -0.75}, phase));
  EXPECT_FALSE(InDomain({.x2 = std::numeric_limits<double>::quiet_NaN()}, phase));
  EXPECT_FALSE(InDomain({.x3 = std::numeric_limits<double>::quiet_NaN()}, phase));
}

}  // namespace
}  // namespace orbitune
