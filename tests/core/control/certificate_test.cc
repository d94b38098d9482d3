#include "core/control/certificate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/control/control_law.h"
#include "tests/core/testing.h"

namespace orbitune {
namespace {

using testing::Cases;
using testing::Random;

// B(c) of docs/model.md, section "Early exit", for p_r = 1: with Lambda at the target's plane, which it comes to as c
// -> 0.
double Bound(double c, const TargetOrbit& target, double k1) {
  const double s = std::sqrt(2 * c), q = 1 - target.eccentricity();
  const double h2 = target.hx * target.hx + target.hy * target.hy;
  const double in_plane = 1 / k1 + 4 * h2 / ((1 + h2) * (1 + h2)), across = 4 / ((1 + h2) * (1 + h2));
  const double both = 4 * h2 * across / ((1 + h2) * (1 + h2));  // (their scalar product)^2 at worst
  const double lambda = (in_plane + across + std::sqrt((in_plane - across) * (in_plane - across) + 4 * both)) / 2;
  const double within = q * (q - s);
  return s * std::max(1 / within, std::sqrt(lambda / within));
}

TEST(SettlingLyapunovTest, IsTheLargestThatTheBoundAllows) {
  Random random(1);
  int capped = 0;
  for (int i = 0; i < 10'000; ++i) {
    const double distance = random.LogUniform(1e-7, 10), k1 = random.LogUniform(1e-3, 1e3);
    const TargetOrbit target = testing::RandomTarget(random, 0.9);
    const double c = SettlingLyapunov(distance, target, k1);
    ASSERT_GT(c, 0);
    const double s = std::sqrt(2 * c), limit = (1 - target.eccentricity()) / 2;
    ASSERT_LT(s, limit) << "the bound is proved for S < q / 2";
    ASSERT_LE(Bound(c, target, k1), distance * (1 + 1e-15));
    capped += s > limit * (1 - 1e-9);
    if (distance < 1e-4 * std::min(1.0, std::sqrt(k1))) {
      ASSERT_NEAR(Bound(c, target, k1) / distance, 1, 1e-3);
    }
  }
  EXPECT_GT(capped, 0);
}

TEST(SettlingLyapunovTest, GrowsWithDistanceAndFirstGain) {
  Random random(2);
  for (int i = 0; i < 1000; ++i) {
    const double distance = random.LogUniform(1e-6, 0.05), k1 = random.LogUniform(0.03, 30);
    const TargetOrbit target = testing::RandomTarget(random, 0.7);
    const double c = SettlingLyapunov(distance, target, k1);
    EXPECT_LT(c, SettlingLyapunov(1.01 * distance, target, k1));
    EXPECT_LE(c, SettlingLyapunov(distance, target, 1.01 * k1));
    if (target.eccentricity() < 0.4 && k1 < 0.2) {  // beyond, the radius or the plane may decide
      EXPECT_LT(c, SettlingLyapunov(distance, target, 1.01 * k1));
    }
  }
}

struct LevelState {
  TargetOrbit target;
  TargetPhase phase;
  CanonicalGains gains;
  ErrorState x;
};

// V(x) = c exactly: its five squares 2 K1 sin^2(x1 / 2), x2^2 / 2, .. are shares of c. The distance feels only x1, x3,
// x5 and x6, so nearly all of it goes to one or a few of those, and the sign that brings the chaser out.
LevelState DrawOnLevel(Random& random, double c, const TargetOrbit& target, const CanonicalGains& gains) {
  double share[6];
  double sum = 0;
  const int concentration = static_cast<int>(random.Uniform(1, 8));
  for (int i = 0; i < 6; ++i) {
    const bool seen = i != 1 && i != 3;  // not x2, nor x4 - xi
    share[i] = std::pow(random.Uniform(0, 1), concentration) * (seen || random.Uniform(0, 1) < 0.1 ? 1 : 0);
    sum += share[i];
  }
  const auto part = [&](int i) { return std::sqrt(c * share[i] / sum) * (random.Uniform(-1, 1) < 0 ? -1 : 1); };
  // Half of the time where the target is farthest out.
  const double apoapsis = std::atan2(-target.ey, -target.ex);
  LevelState state{.target = target,
                   .phase = target.PhaseAt(random.Uniform(0, 1) < 0.5 ? apoapsis : random.Angle()),
                   .gains = gains,
                   .x = {}};
  ErrorState& x = state.x;
  x.x1 = 2 * std::asin(std::clamp(part(0) / std::sqrt(2 * gains.k1), -1.0, 1.0));
  x.x2 = std::sqrt(2.0) * part(1);
  x.x3 = std::sqrt(2.0) * part(2);
  x.x5 = std::sqrt(2.0) * part(4);
  x.x6 = std::sqrt(2.0) * part(5);
  const double a = InverseRadius(x, state.phase), f13 = x.x3 + 2 + 2 * state.phase.zeta_x;
  const double xi = (gains.k1 * f13 * std::sin(x.x1) + (gains.k3 - f13 * state.phase.zeta_y) * x.x3) / (a * a);
  x.x4 = xi + std::sqrt(2.0) * part(3);
  return state;
}

// Soundness: whatever is on the level c* is within the distance. Everything below the level is on a lower one, which
// belongs to a smaller distance, so that the level itself is the whole test.
TEST(SettlingLyapunovTest, NothingOnTheLevelIsFartherThanPromised) {
  constexpr int kStates = Cases(300'000);
  std::vector<double> closest(kStates);  // y / eps
  testing::ParallelFor(kStates, [&](int i) {
    Random random(static_cast<std::uint64_t>(i) + 1);
    const TargetOrbit target = testing::RandomTarget(random, 0.7);
    CanonicalGains gains = ToCanonical(testing::RandomGains(random), {});
    gains.k1 = random.LogUniform(1e-3, 30);  // the smaller, the more of the bound is x1's alone
    const double distance = random.LogUniform(1e-6, 1);
    const double c = SettlingLyapunov(distance, target, gains.k1);
    const LevelState state = DrawOnLevel(random, c, target, gains);
    const double lyapunov = EvaluateLaw(state.x, target, state.phase, gains).lyapunov;
    EXPECT_NEAR(lyapunov / c, 1, 1e-6);  // x4 - xi cancels where c is small
    EXPECT_TRUE(InDomain(state.x, state.phase));
    closest[static_cast<std::size_t>(i)] = Distance(state.x, target, state.phase) / distance;
  });
  const double worst = *std::ranges::max_element(closest);
  EXPECT_LE(worst, 1);
  EXPECT_GT(worst, 0.8) << "the states come nowhere near the promise, and test nothing";
  RecordProperty("worst_ratio", std::to_string(worst));
}

TEST(StaysInDomainTest, IsHalfTheSquareOfWhatTheEccentricityLeaves) {
  EXPECT_TRUE(StaysInDomain(0.4999, 0));
  EXPECT_FALSE(StaysInDomain(0.5, 0));
  EXPECT_TRUE(StaysInDomain(0.1249, 0.5));
  EXPECT_FALSE(StaysInDomain(0.1251, 0.5));
  EXPECT_FALSE(StaysInDomain(std::nan(""), 0));
}

// No state outside the domain, nor on its edge, has a V that the promise covers.
TEST(StaysInDomainTest, TheEdgeLiesAboveTheLevel) {
  Random random(6);
  for (int i = 0; i < 10'000; ++i) {
    const TargetOrbit target = testing::RandomTarget(random, 0.7);
    const double longitude = random.Angle();
    const TargetPhase phase = target.PhaseAt(longitude);
    const CanonicalGains gains = ToCanonical(testing::RandomGains(random), {});
    ErrorState x = testing::RandomState(random, phase);
    (random.Uniform(0, 1) < 0.5 ? x.x2 : x.x3) = -1 + 1e-9;
    if (x.x3 == -1 + 1e-9) x.x3 = -1 - phase.zeta_x + 1e-9;
    const double lyapunov = EvaluateLaw(x, target, phase, gains).lyapunov;
    ASSERT_FALSE(StaysInDomain(lyapunov * (1 + 1e-6), target.eccentricity()));
  }
}

}  // namespace
}  // namespace orbitune
