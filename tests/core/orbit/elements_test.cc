#include "core/orbit/elements.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <numbers>

#include "tests/core/testing.h"

namespace orbitune {
namespace {

using ::testing::HasSubstr;
using testing::Random;

constexpr double kPi = std::numbers::pi;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kOrbits = 5000;

struct RandomOrbit {
  KeplerianElements elements;
  double mu = 1;
};

// Any units; e up to 0.99, i up to 179 deg.
RandomOrbit DrawOrbit(Random& random) {
  return {.elements = {.semi_major_axis = random.LogUniform(1e-3, 1e9),
                       .eccentricity = random.Uniform(0, 0.99),
                       .inclination = random.Uniform(0, 179 * kPi / 180),
                       .raan = random.Angle(),
                       .argument_of_periapsis = random.Angle(),
                       .true_anomaly = random.Angle()},
          .mu = random.LogUniform(1e-6, 1e12)};
}

// By the textbook: the perifocal frame, turned into the inertial one.
CartesianState ByRotation(const KeplerianElements& k, double mu) {
  using Eigen::AngleAxisd;
  using Eigen::Vector3d;
  const Eigen::Matrix3d turn = (AngleAxisd(k.raan, Vector3d::UnitZ()) * AngleAxisd(k.inclination, Vector3d::UnitX()) *
                                AngleAxisd(k.argument_of_periapsis, Vector3d::UnitZ()))
                                   .toRotationMatrix();
  const double p = k.semi_major_axis * (1 - k.eccentricity * k.eccentricity);
  const double c = std::cos(k.true_anomaly), s = std::sin(k.true_anomaly);
  return {.position = turn * Vector3d(c, s, 0) * (p / (1 + k.eccentricity * c)),
          .velocity = turn * Vector3d(-s, k.eccentricity + c, 0) * std::sqrt(mu / p)};
}

double AngleBetween(double a, double b) { return std::abs(std::remainder(a - b, 2 * kPi)); }

double RelativeDifference(const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return (a - b).norm() / b.norm(); }

TEST(ElementsTest, CartesianIsWhatTheTextbookGives) {
  Random random(1);
  for (int i = 0; i < kOrbits; ++i) {
    const auto [k, mu] = DrawOrbit(random);
    const CartesianState expected = ByRotation(k, mu);
    const auto state = ToCartesian(*ToEquinoctial(k), mu);
    ASSERT_TRUE(state.ok()) << state.status();
    // At e = 0.99 an ulp of the anomaly near apoapsis moves the radius by a hundred.
    ASSERT_LT(RelativeDifference(state->position, expected.position), 1e-12);
    ASSERT_LT(RelativeDifference(state->velocity, expected.velocity), 1e-12);
  }
}

TEST(ElementsTest, CartesianHasTheOrbitsConstants) {
  Random random(2);
  for (int i = 0; i < kOrbits; ++i) {
    const auto [k, mu] = DrawOrbit(random);
    const auto [r, v] = *ToCartesian(*ToEquinoctial(k), mu);
    const double p = k.semi_major_axis * (1 - k.eccentricity * k.eccentricity);
    const Eigen::Vector3d h = r.cross(v);
    ASSERT_NEAR(h.norm() / std::sqrt(mu * p), 1, 1e-12);
    ASSERT_NEAR(h.z() / h.norm(), std::cos(k.inclination), 1e-12);
    // Energy, against its kinetic part: at periapsis of e = 0.99 that is 200 times as large.
    const double energy = v.squaredNorm() / 2 - mu / r.norm();
    ASSERT_NEAR(energy, -mu / (2 * k.semi_major_axis), 1e-12 * v.squaredNorm());
    const Eigen::Vector3d eccentricity = v.cross(h) / mu - r.normalized();
    ASSERT_NEAR(eccentricity.norm(), k.eccentricity, 1e-12);
    ASSERT_NEAR(eccentricity.dot(r.normalized()), k.eccentricity * std::cos(k.true_anomaly), 1e-12);
  }
}

TEST(ElementsTest, KeplerianRoundTrip) {
  Random random(3);
  for (int i = 0; i < kOrbits; ++i) {
    const KeplerianElements k = DrawOrbit(random).elements;
    const auto back = ToKeplerian(*ToEquinoctial(k));
    ASSERT_TRUE(back.ok()) << back.status();
    // An angle is known to an ulp over the eccentricity (or the sine of the inclination) that it is the angle of.
    const double periapsis = 1e-14 / k.eccentricity, node = 1e-14 / std::sin(k.inclination / 2);
    ASSERT_NEAR(back->semi_major_axis / k.semi_major_axis, 1, 1e-13);
    ASSERT_NEAR(back->eccentricity, k.eccentricity, 1e-14);
    ASSERT_NEAR(back->inclination, k.inclination, 1e-14);
    ASSERT_LT(AngleBetween(back->raan, k.raan), node);
    ASSERT_LT(AngleBetween(back->argument_of_periapsis, k.argument_of_periapsis), periapsis + node);
    ASSERT_LT(AngleBetween(back->true_anomaly, k.true_anomaly), periapsis);
  }
}

TEST(ElementsTest, CartesianRoundTrip) {
  Random random(4);
  for (int i = 0; i < kOrbits; ++i) {
    const auto [k, mu] = DrawOrbit(random);
    const EquinoctialElements m = *ToEquinoctial(k);
    const auto back = ToEquinoctial(*ToCartesian(m, mu), mu);
    ASSERT_TRUE(back.ok()) << back.status();
    // 1 + cos i loses digits towards 180 deg, and e near 1 loses them in every constant.
    const double lost = 1e-13 / ((1 + std::cos(k.inclination)) * (1 - k.eccentricity));
    ASSERT_NEAR(back->p / m.p, 1, 1e-12);
    ASSERT_LT(std::hypot(back->hx - m.hx, back->hy - m.hy), lost * std::max(1.0, std::hypot(m.hx, m.hy)));
    ASSERT_LT(std::hypot(back->ex - m.ex, back->ey - m.ey), lost);
    ASSERT_LT(AngleBetween(back->true_longitude, m.true_longitude), lost);
  }
}

TEST(ElementsTest, UndefinedAnglesAreZeroByConvention) {
  const auto equatorial = ToKeplerian(*ToEquinoctial(KeplerianElements{
      .semi_major_axis = 2, .eccentricity = 0.3, .raan = 0.4, .argument_of_periapsis = 0.5, .true_anomaly = 0.6}));
  ASSERT_TRUE(equatorial.ok());
  EXPECT_EQ(equatorial->raan, 0);
  EXPECT_NEAR(equatorial->argument_of_periapsis, 0.9, 1e-15);
  EXPECT_NEAR(equatorial->true_anomaly, 0.6, 1e-15);

  const auto circular = ToKeplerian(*ToEquinoctial(KeplerianElements{
      .semi_major_axis = 2, .inclination = 1, .raan = 0.4, .argument_of_periapsis = 0.5, .true_anomaly = 0.6}));
  ASSERT_TRUE(circular.ok());
  EXPECT_NEAR(circular->raan, 0.4, 1e-15);
  EXPECT_EQ(circular->argument_of_periapsis, 0);
  EXPECT_NEAR(circular->true_anomaly, 1.1, 1e-15);
}

// The whole turns of a longitude are kept: the controller's x1 is unwrapped.
TEST(ElementsTest, LongitudeStaysUnwrapped) {
  EXPECT_DOUBLE_EQ(ToEquinoctial(KeplerianElements{.semi_major_axis = 1, .true_anomaly = 40})->true_longitude, 40);
}

TEST(ElementsTest, RadialDirectionIsThePositionsUnitVector) {
  Random random(5);
  for (int i = 0; i < 100; ++i) {
    const EquinoctialElements m = *ToEquinoctial(DrawOrbit(random).elements);
    const Eigen::Vector3d direction =
        RadialDirection(std::sin(m.true_longitude), std::cos(m.true_longitude), m.hx, m.hy);
    EXPECT_LT((direction - ToCartesian(m, 1)->position.normalized()).norm(), 1e-14);
  }
}

// Field by field: the first violation names `field` and its description holds `text`.
void ExpectRefused(const absl::Status& status, std::string_view field, std::string_view text) {
  SCOPED_TRACE(status.ToString());
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  const auto violations = FieldViolationsOf(status);
  ASSERT_EQ(violations.size(), 1u);
  EXPECT_EQ(violations[0].field, field);
  EXPECT_THAT(violations[0].description, HasSubstr(std::string(text)));
}

TEST(ElementsTest, KeplerianErrorsNameTheField) {
  const KeplerianElements good{.semi_major_axis = 7000, .eccentricity = 0.1, .inclination = 1};
  ASSERT_TRUE(Validate(good).ok());
  const auto with = [&](double KeplerianElements::*field, double value) {
    KeplerianElements k = good;
    k.*field = value;
    EXPECT_EQ(ToEquinoctial(k).status(), Validate(k));
    return Validate(k);
  };
  ExpectRefused(with(&KeplerianElements::semi_major_axis, -7000), "semi_major_axis", "> 0 and finite, got -7000");
  ExpectRefused(with(&KeplerianElements::semi_major_axis, kInfinity), "semi_major_axis", "got inf");
  ExpectRefused(with(&KeplerianElements::eccentricity, 1), "eccentricity", "in [0, 1), an ellipse, got 1");
  ExpectRefused(with(&KeplerianElements::eccentricity, -0.1), "eccentricity", "got -0.1");
  ExpectRefused(with(&KeplerianElements::eccentricity, kNan), "eccentricity", "got nan");
  ExpectRefused(with(&KeplerianElements::inclination, kPi), "inclination", "singular, got 3.14159");
  ExpectRefused(with(&KeplerianElements::inclination, -0.1), "inclination", "got -0.1");
  ExpectRefused(with(&KeplerianElements::raan, kNan), "raan", "a finite number, got nan");
  ExpectRefused(with(&KeplerianElements::argument_of_periapsis, kInfinity), "argument_of_periapsis", "got inf");
  ExpectRefused(with(&KeplerianElements::true_anomaly, -kInfinity), "true_anomaly", "got -inf");
}

TEST(ElementsTest, EquinoctialErrorsNameTheField) {
  const EquinoctialElements good{.p = 7000, .ex = 0.1};
  ASSERT_TRUE(Validate(good).ok());
  const auto with = [&](double EquinoctialElements::*field, double value) {
    EquinoctialElements m = good;
    m.*field = value;
    EXPECT_EQ(ToKeplerian(m).status(), Validate(m));
    EXPECT_EQ(ToCartesian(m, 1).status(), Validate(m));
    return Validate(m);
  };
  ExpectRefused(with(&EquinoctialElements::p, 0), "p", "> 0 and finite, got 0");
  ExpectRefused(with(&EquinoctialElements::ex, kNan), "ex", "got nan");
  ExpectRefused(with(&EquinoctialElements::ey, kNan), "ey", "got nan");
  ExpectRefused(with(&EquinoctialElements::hx, kInfinity), "hx", "got inf");
  ExpectRefused(with(&EquinoctialElements::hy, -kInfinity), "hy", "got -inf");
  ExpectRefused(with(&EquinoctialElements::true_longitude, kNan), "true_longitude", "got nan");
  ExpectRefused(with(&EquinoctialElements::ey, 1.5), "eccentricity", "< 1, an ellipse");
  ExpectRefused(ToCartesian(good, 0).status(), "mu", "> 0 and finite, got 0");
}

TEST(ElementsTest, EveryBadFieldIsNamedAtOnce) {
  const auto violations = FieldViolationsOf(Validate(EquinoctialElements{.p = -1, .hx = kNan, .hy = kNan}));
  ASSERT_EQ(violations.size(), 3u);
  EXPECT_EQ(violations[0].field, "p");
  EXPECT_EQ(violations[1].field, "hx");
  EXPECT_EQ(violations[2].field, "hy");
}

TEST(ElementsTest, CartesianErrorsSayWhy) {
  const auto refuse = [](const Eigen::Vector3d& r, const Eigen::Vector3d& v, double mu, std::string_view field,
                         std::string_view text) {
    ExpectRefused(ToEquinoctial(CartesianState{r, v}, mu).status(), field, text);
  };
  refuse({0, 0, 0}, {0, 1, 0}, 1, "position", "length > 0, got 0");
  refuse({1, kNan, 0}, {0, 1, 0}, 1, "position", "got nan");
  refuse({1, 0, 0}, {0, kInfinity, 0}, 1, "velocity", "a finite vector, got inf");
  refuse({1, 0, 0}, {0, 1, 0}, -1, "mu", "got -1");
  refuse({1, 2, 3}, {2, 4, 6}, 1, "velocity", "radial trajectory");
  refuse({1, 2, 3}, {0, 0, 0}, 1, "velocity", "radial trajectory");
  refuse({1, 0, 0}, {0, -1, 0}, 1, "inclination", "singular");
  refuse({1, 0, 0}, {0, 1.5, 0}, 1, "eccentricity", "< 1, an ellipse");
}

}  // namespace
}  // namespace orbitune
