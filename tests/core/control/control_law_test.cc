#include "core/control/control_law.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <type_traits>

#include "tests/core/testing.h"

namespace orbitune {
namespace {

using testing::Cases;
using testing::Random;
using testing::RandomState;
using testing::RandomTarget;

// One state of everything that moves, and a direction for it to move in.
struct Motion {
  TargetOrbit target;
  double longitude = 0;  // L_r
  ErrorState x;
  CanonicalGains gains;
  LawValue law;
  ErrorState rates;
  double longitude_rate = 0;

  TargetPhase phase() const { return target.PhaseAt(longitude); }

  // The straight line along the rates.
  ErrorState Along(double t) const {
    return {x.x1 + t * rates.x1, x.x2 + t * rates.x2, x.x3 + t * rates.x3,
            x.x4 + t * rates.x4, x.x5 + t * rates.x5, x.x6 + t * rates.x6};
  }
  TargetPhase PhaseAlong(double t) const { return target.PhaseAt(longitude + t * longitude_rate); }

  double speed() const {
    return std::hypot(std::hypot(rates.x1, rates.x2, rates.x3), std::hypot(rates.x4, rates.x5, rates.x6),
                      longitude_rate);
  }
};

Motion DrawMotion(Random& random) {
  Motion m;
  m.target = RandomTarget(random, 0.7);
  m.longitude = random.Angle();
  m.x = RandomState(random, m.phase());
  m.gains = ToCanonical(testing::RandomGains(random), {});
  m.law = EvaluateLaw(m.x, m.target, m.phase(), m.gains);
  m.rates = ErrorRates(m.x, m.target, m.phase(), m.law.u);
  m.longitude_rate = TargetOrbit::LongitudeRate(m.phase());
  return m;
}

// The derivative of f at 0: a central difference of fourth order.
template <typename F>
std::invoke_result_t<F, double> Derivative(const F& f, double h) {
  return (8 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12 * h);
}

// The property that the paper's proof rests on (docs/model.md, section 3).
TEST(ControlLawTest, LyapunovFunctionDecreasesAsProved) {
  Random random(1);
  for (int i = 0; i < Cases(10'000); ++i) {
    const Motion m = DrawMotion(random);
    const auto lyapunov = [&](double t) {
      return EvaluateLaw(m.Along(t), m.target, m.PhaseAlong(t), m.gains).lyapunov;
    };
    const double h = 3e-4 / m.speed();
    ASSERT_LE(m.law.lyapunov_rate, 0);
    ASSERT_NEAR(Derivative(lyapunov, h), m.law.lyapunov_rate, 1e-6 * std::abs(m.law.lyapunov_rate)) << "state " << i;
  }
}

// The same without the law's own word for dV/dt: the quadratic form, from V's parts by difference.
TEST(ControlLawTest, LyapunovRateIsTheQuadraticForm) {
  Random random(2);
  for (int i = 0; i < Cases(10'000); ++i) {
    const Motion m = DrawMotion(random);
    const double s1 = std::sin(m.x.x1), zeta_x = m.phase().zeta_x, zeta_y = m.phase().zeta_y;
    const double f12 = std::pow(InverseRadius(m.x, m.phase()), 2), f13 = m.x.x3 + 2 + 2 * zeta_x;
    const double xi = (m.gains.k1 * f13 * s1 + (m.gains.k3 - f13 * zeta_y) * m.x.x3) / f12;
    const double z = m.x.x4 - xi;
    const double lyapunov = m.gains.k1 * (1 - std::cos(m.x.x1)) +
                            (m.x.x2 * m.x.x2 + m.x.x3 * m.x.x3 + z * z + m.x.x5 * m.x.x5 + m.x.x6 * m.x.x6) / 2;
    ASSERT_NEAR(m.law.lyapunov, lyapunov, 1e-12 * lyapunov);
    const double v_h = -m.law.u.normal / m.gains.k5;
    const double rate =
        -m.gains.k2 * m.x.x2 * m.x.x2 - m.gains.k3 * m.x.x3 * m.x.x3 - m.gains.k4 * z * z - m.gains.k5 * v_h * v_h;
    ASSERT_NEAR(m.law.lyapunov_rate, rate, 1e-12 * std::abs(rate));

    // dV/dx H by difference: the change of V that a unit of normal acceleration makes.
    const auto rest = ErrorRates(m.x, m.target, m.phase(), {});
    const auto push = ErrorRates(m.x, m.target, m.phase(), {.normal = 1});
    const auto pushed = [&](double t) {
      const ErrorState x{m.x.x1 + t * (push.x1 - rest.x1), m.x.x2, m.x.x3, m.x.x4, m.x.x5 + t * (push.x5 - rest.x5),
                         m.x.x6 + t * (push.x6 - rest.x6)};
      return EvaluateLaw(x, m.target, m.phase(), m.gains).lyapunov;
    };
    const double h = 1e-3 / (1 + std::hypot(push.x1 - rest.x1, push.x5, push.x6));
    ASSERT_NEAR(Derivative(pushed, h), v_h, 1e-6 * std::abs(v_h) + 1e-9 * (1 + lyapunov));
  }
}

TEST(ControlLawTest, RestsOnTheTarget) {
  Random random(3);
  for (int i = 0; i < 100; ++i) {
    const TargetOrbit target = RandomTarget(random, 0.7);
    const LawValue law =
        EvaluateLaw({}, target, target.PhaseAt(random.Angle()), ToCanonical(testing::RandomGains(random), {}));
    EXPECT_EQ(law.u.norm(), 0);
    EXPECT_EQ(law.lyapunov, 0);
  }
}

TEST(ControlLawTest, SeesTheLongitudeErrorModuloWholeTurns) {
  Random random(4);
  const Motion m = DrawMotion(random);
  ErrorState turned = m.x;
  turned.x1 += 2 * 3.14159265358979323846;
  const LawValue law = EvaluateLaw(turned, m.target, m.phase(), m.gains);
  EXPECT_NEAR(law.lyapunov, m.law.lyapunov, 1e-12 * m.law.lyapunov);
  EXPECT_NEAR(law.u.norm(), m.law.u.norm(), 1e-12 * m.law.u.norm());
}

TEST(GainsTest, TakeTheScenariosUnits) {
  const CanonicalGains k = ToCanonical({1, 2, 3, 4, 5}, {.velocity = 2, .acceleration = 3});
  EXPECT_EQ(k.k1, 2);
  EXPECT_EQ(k.k2, 6);
  EXPECT_EQ(k.k3, 9);
  EXPECT_EQ(k.k4, 12);
  EXPECT_EQ(k.k5, 15);
}

// Two-body motion with a constant acceleration in the initial radial, transverse, normal frame; mu = 1. One step of the
// classical Runge-Kutta method.
CartesianState Fly(const CartesianState& state, const Eigen::Vector3d& acceleration, double t) {
  const auto fall = [&](const Eigen::Vector3d& r) -> Eigen::Vector3d {
    return acceleration - r / std::pow(r.norm(), 3);
  };
  const Eigen::Vector3d &r = state.position, &v = state.velocity;
  const Eigen::Vector3d v1 = v, a1 = fall(r);
  const Eigen::Vector3d v2 = v + t / 2 * a1, a2 = fall(r + t / 2 * v1);
  const Eigen::Vector3d v3 = v + t / 2 * a2, a3 = fall(r + t / 2 * v2);
  const Eigen::Vector3d v4 = v + t * a3, a4 = fall(r + t * v3);
  return {r + t / 6 * (v1 + 2 * v2 + 2 * v3 + v4), v + t / 6 * (a1 + 2 * a2 + 2 * a3 + a4)};
}

// The model against Newton: chaser and target flown in Cartesian coordinates, and turned back into x.
TEST(ErrorRatesTest, AgreeWithCartesianMotion) {
  Random random(5);
  int compared = 0;
  for (int i = 0; i < Cases(10'000); ++i) {
    Motion m = DrawMotion(random);
    const EquinoctialElements chaser = ChaserElements(m.x, m.target, m.longitude);
    if (chaser.eccentricity() > 0.9) continue;  // the conversions refuse what is no ellipse
    ++compared;
    const Control u{
        .radial = random.Uniform(-2, 2), .transverse = random.Uniform(-2, 2), .normal = random.Uniform(-2, 2)};
    m.rates = ErrorRates(m.x, m.target, m.phase(), u);
    const CartesianState state = *ToCartesian(chaser, 1);
    const CartesianState reference = *ToCartesian(ChaserElements({}, m.target, m.longitude), 1);
    const Eigen::Vector3d radial = state.position.normalized();
    const Eigen::Vector3d normal = state.position.cross(state.velocity).normalized();
    const Eigen::Vector3d acceleration = u.radial * radial + u.transverse * normal.cross(radial) + u.normal * normal;
    const auto error_at = [&](double t) {
      const EquinoctialElements target_then = *ToEquinoctial(Fly(reference, Eigen::Vector3d::Zero(), t), 1);
      const ErrorState x =
          ErrorBetween(*ToEquinoctial(Fly(state, acceleration, t), 1), m.target, target_then.true_longitude);
      return Eigen::Matrix<double, 6, 1>{
          std::remainder(x.x1 - m.x.x1, 6.283185307179586), x.x2, x.x3, x.x4, x.x5, x.x6};
    };
    // Small beside the time scales of the fall, of the errors and of u.
    const double h = 1e-3 * std::min(1.0, std::pow(state.position.norm(), 1.5)) / (1 + m.speed());
    const Eigen::Matrix<double, 6, 1> slope = Derivative(error_at, h);
    const Eigen::Matrix<double, 6, 1> rates{m.rates.x1, m.rates.x2, m.rates.x3, m.rates.x4, m.rates.x5, m.rates.x6};
    ASSERT_LT((slope - rates).norm(), 1e-6 * rates.norm() + 1e-9) << "state " << i;
  }
  EXPECT_GT(compared, Cases(3000));
}

}  // namespace
}  // namespace orbitune
