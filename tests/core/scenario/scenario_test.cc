#include "core/scenario/scenario.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "core/scenario/presets.h"
#include "tests/core/testing.h"

namespace orbitune {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr double kDegree = std::numbers::pi / 180;

struct BadField {
  const char* name;
  void (*change)(Scenario&);
  const char* field;
  const char* description;
};

void PrintTo(const BadField& bad, std::ostream* os) { *os << bad.field; }

class ScenarioValidateTest : public ::testing::TestWithParam<BadField> {};

TEST_P(ScenarioValidateTest, NamesFieldRangeAndValue) {
  Scenario scenario = *FindPreset("leo-rendezvous");
  GetParam().change(scenario);
  const auto violations = FieldViolationsOf(scenario.Validate());
  ASSERT_EQ(violations.size(), 1u) << scenario.Validate();
  EXPECT_EQ(violations[0].field, GetParam().field);
  EXPECT_EQ(violations[0].description, GetParam().description);
  EXPECT_EQ(Prepare(scenario).status(), scenario.Validate());
}

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

INSTANTIATE_TEST_SUITE_P(
    , ScenarioValidateTest,
    ::testing::Values(BadField{"Mu", [](Scenario& s) { s.gravitational_parameter_km3_s2 = 0; },
                               "gravitational_parameter_km3_s2", "must be > 0 and finite, got 0"},
                      BadField{"NoTarget", [](Scenario& s) { s.target = {}; }, "target.form",
                               "must be one of keplerian, equinoctial, cartesian, got none"},
                      BadField{"NoChaser", [](Scenario& s) { s.chaser = {}; }, "chaser.form",
                               "must be one of keplerian, equinoctial, cartesian, got none"},
                      BadField{"TargetOrbit", [](Scenario& s) { s.target = EquinoctialState{.p_km = -1}; },
                               "target.equinoctial.p_km", "must be > 0 and finite, got -1"},
                      BadField{"SamplingPeriod", [](Scenario& s) { s.sampling_period_s = -60; }, "sampling_period_s",
                               "must be > 0 and finite, got -60"},
                      BadField{"NoHorizon", [](Scenario& s) { s.horizon_samples = 0; }, "horizon_samples",
                               "must be in [1, 100000], got 0"},
                      BadField{"LongHorizon", [](Scenario& s) { s.horizon_samples = 100'001; }, "horizon_samples",
                               "must be in [1, 100000], got 100001"},
                      BadField{"FuelWeight", [](Scenario& s) { s.fuel_weight = -1; }, "fuel_weight",
                               "must be in [0, 1e+09], got -1"},
                      BadField{"SettlingDistance", [](Scenario& s) { s.settling_distance_km = kNan; },
                               "settling_distance_km", "must be > 0 and finite, got nan"},
                      BadField{"VelocityUnit", [](Scenario& s) { s.velocity_unit_m_s = -1; }, "velocity_unit_m_s",
                               "must be > 0 and finite, or 0 for sqrt(mu / p_target), got -1"},
                      BadField{"AccelerationUnit", [](Scenario& s) { s.acceleration_unit_m_s2 = kNan; },
                               "acceleration_unit_m_s2", "must be > 0 and finite, or 0 for mu / p_target^2, got nan"},
                      BadField{"CoarseTolerance", [](Scenario& s) { s.integration_tolerance = 1e-4; },
                               "integration_tolerance", "must be in [1e-13, 1e-5], got 1e-04"},
                      BadField{"ZeroTolerance", [](Scenario& s) { s.integration_tolerance = 0; },
                               "integration_tolerance", "must be in [1e-13, 1e-5], got 0"}),
    [](const auto& test) { return std::string(test.param.name); });

TEST(ScenarioTest, ValidateNamesEveryBadFieldAtOnce) {
  const auto violations = FieldViolationsOf(Scenario().Validate());
  std::vector<std::string> fields;
  for (const auto& v : violations) fields.push_back(v.field);
  EXPECT_THAT(fields, ::testing::ElementsAre("target.form", "chaser.form", "sampling_period_s", "horizon_samples",
                                             "settling_distance_km"));
}

TEST(ScenarioTest, FuelMayWeighNothing) {
  Scenario scenario = *FindPreset("gto-geo");
  scenario.fuel_weight = 0;
  EXPECT_TRUE(scenario.Validate().ok());
}

// The same orbits in each of the three forms.
TEST(PrepareTest, FormsOfAnOrbitGiveTheSameProblem) {
  testing::Random random(8);
  for (int i = 0; i < 200; ++i) {
    Scenario scenario = testing::RandomEllipticScenario(random);
    const double mu = scenario.gravitational_parameter_km3_s2;
    const auto in_form = [&](auto&& convert) {
      Scenario other = scenario;
      other.target = convert(*Resolve(scenario.target, mu));
      other.chaser = convert(*Resolve(scenario.chaser, mu));
      const auto prepared = Prepare(other);
      EXPECT_TRUE(prepared.ok()) << prepared.status();
      return prepared->problem;
    };
    const EpisodeProblem equinoctial = Prepare(scenario)->problem;
    const EpisodeProblem keplerian = in_form([](const EquinoctialElements& m) {
      const KeplerianElements k = *ToKeplerian(m);
      return KeplerianState{.semi_major_axis_km = k.semi_major_axis,
                            .eccentricity = k.eccentricity,
                            .inclination_deg = k.inclination / kDegree,
                            .raan_deg = k.raan / kDegree,
                            .argument_of_periapsis_deg = k.argument_of_periapsis / kDegree,
                            .position_deg = k.true_anomaly / kDegree};
    });
    const EpisodeProblem cartesian = in_form([&](const EquinoctialElements& m) {
      const auto [r, v] = *ToCartesian(m, mu);
      return CartesianStateKm{r.x(), r.y(), r.z(), v.x(), v.y(), v.z()};
    });
    for (const EpisodeProblem& problem : {keplerian, cartesian}) {
      const ErrorState &x = problem.initial_error, &y = equinoctial.initial_error;
      // Longitudes may differ by whole turns.
      ASSERT_NEAR(std::remainder(x.x1 - y.x1, 360 * kDegree), 0, 1e-12);
      ASSERT_NEAR(x.x2, y.x2, 1e-12);
      ASSERT_NEAR(x.x3, y.x3, 1e-12);
      ASSERT_NEAR(x.x4, y.x4, 1e-12);
      ASSERT_NEAR(x.x5, y.x5, 1e-12);
      ASSERT_NEAR(x.x6, y.x6, 1e-12);
      const TargetOrbit &a = problem.target, &b = equinoctial.target;
      ASSERT_NEAR(std::remainder(a.initial_longitude - b.initial_longitude, 360 * kDegree), 0, 1e-12);
      ASSERT_NEAR(a.ex, b.ex, 1e-12);
      ASSERT_NEAR(a.ey, b.ey, 1e-12);
      ASSERT_NEAR(a.hx, b.hx, 1e-12);
      ASSERT_NEAR(a.hy, b.hy, 1e-12);
      ASSERT_NEAR(problem.sampling_period, equinoctial.sampling_period, 1e-12);
      ASSERT_NEAR(problem.settling_distance, equinoctial.settling_distance, 1e-12);
      ASSERT_NEAR(problem.gain_units.velocity, 1, 1e-12);
      ASSERT_NEAR(problem.gain_units.acceleration, 1, 1e-12);
    }
  }
}

TEST(PrepareTest, UnitsScaleTheGains) {
  Scenario scenario = *FindPreset("gto-geo");
  scenario.velocity_unit_m_s = 0;
  scenario.acceleration_unit_m_s2 = 0;
  auto prepared = Prepare(scenario);
  ASSERT_TRUE(prepared.ok());
  EXPECT_EQ(prepared->problem.gain_units.velocity, 1);
  EXPECT_EQ(prepared->problem.gain_units.acceleration, 1);
  EXPECT_EQ(prepared->velocity_unit_m_s, prepared->units.velocity_m_s());
  scenario.velocity_unit_m_s = 1;
  scenario.acceleration_unit_m_s2 = 1;
  prepared = Prepare(scenario);
  EXPECT_DOUBLE_EQ(prepared->problem.gain_units.velocity * prepared->units.velocity_m_s(), 1);
  EXPECT_DOUBLE_EQ(prepared->problem.gain_units.acceleration * prepared->units.acceleration_m_s2(), 1);
}

TEST(PrepareTest, CarriesTheRestOver) {
  Scenario scenario = *FindPreset("gto-geo");
  scenario.control_hold = ControlHold::kZeroOrder;
  scenario.integration_tolerance = 1e-10;
  const auto prepared = Prepare(scenario);
  EXPECT_EQ(prepared->problem.hold, ControlHold::kZeroOrder);
  EXPECT_EQ(prepared->problem.tolerance, 1e-10);
  EXPECT_EQ(prepared->problem.horizon_samples, 1280);
  EXPECT_EQ(prepared->problem.fuel_weight, 50);
  EXPECT_NEAR(prepared->problem.sampling_period * prepared->units.time_s, 2700, 1e-9);
  EXPECT_NEAR(prepared->problem.settling_distance * prepared->units.length_km, 10, 1e-12);
}

TEST(PrepareTest, InitialConditionReplacesTheChaser) {
  const Scenario& scenario = *FindPreset("leo-rendezvous");
  const auto own = Prepare(scenario);
  const auto same = Prepare(scenario, scenario.chaser);
  EXPECT_EQ(own->problem.initial_error.x1, same->problem.initial_error.x1);
  const auto target = Prepare(scenario, scenario.target);
  EXPECT_EQ(target->problem.initial_error.x1, 0);
  EXPECT_EQ(target->problem.initial_error.x2, 0);

  const auto violations = FieldViolationsOf(Prepare(scenario, EquinoctialState{.p_km = 0}).status());
  ASSERT_EQ(violations.size(), 1u);
  EXPECT_EQ(violations[0].field, "initial_condition.equinoctial.p_km");
}

TEST(DescribeOutcomeTest, SaysWhereAndWhyAnEpisodeEnded) {
  const auto prepared = Prepare(*FindPreset("gto-geo"));
  const auto describe = [&](const EpisodeResult& result) { return DescribeOutcome(result, *prepared); };
  EXPECT_EQ(describe({.outcome = Outcome::kSettled}), "");
  EXPECT_THAT(describe({.outcome = Outcome::kNotSettled, .end_time = 1}), StartsWith("not settled within the horizon"));
  EXPECT_THAT(describe({.outcome = Outcome::kLeftDomain, .end_time = 1, .momentum_ratio = 0.9, .inverse_radius = 1e-5}),
              HasSubstr("the radius grew without bound"));
  EXPECT_THAT(describe({.outcome = Outcome::kLeftDomain, .end_time = 1, .momentum_ratio = 1e-5, .inverse_radius = 1}),
              HasSubstr("the angular momentum reached zero"));
  // One canonical unit of time.
  EXPECT_THAT(describe({.outcome = Outcome::kNumericalFailure, .end_time = 1}), HasSubstr("at t = 13713.8 s"));
}

}  // namespace
}  // namespace orbitune
