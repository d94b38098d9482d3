#include "core/sim/scalar_simulator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/control/certificate.h"
#include "core/scenario/presets.h"
#include "tests/core/testing.h"

namespace orbitune {
namespace {

using ::testing::HasSubstr;

constexpr Gains kFirstGains{0.1, 1, 1, 1, 10};        // K(1) of the paper
constexpr Gains kTunedGains{0.7, 0.2, 0.8, 0.75, 3};  // as a search finds them

PreparedScenario Preset(std::string_view id) { return *Prepare(*FindPreset(id)); }

std::vector<EpisodeSample> Trajectory(const EpisodeProblem& problem, const Gains& gains) {
  std::vector<EpisodeSample> trajectory;
  SimulateEpisode(problem, gains, {.early_exit = false, .trajectory = &trajectory});
  return trajectory;
}

double ControlSum(const EpisodeProblem& problem, const std::vector<EpisodeSample>& trajectory, std::size_t samples) {
  double sum = 0;
  for (std::size_t k = 0; k < samples; ++k) sum += trajectory[k].control.norm() / problem.gain_units.acceleration;
  return sum;
}

TEST(ScalarSimulatorTest, PrintedLongitudeOfPeriapsisLeavesTheDomain) {
  const PreparedScenario printed = Preset("gto-geo-printed");
  const EpisodeResult result = SimulateEpisode(printed.problem, kFirstGains, {.measure_effort = true});
  EXPECT_EQ(result.outcome, Outcome::kLeftDomain);
  EXPECT_FALSE(HasCost(result.outcome));
  EXPECT_TRUE(std::isnan(result.cost));
  EXPECT_TRUE(std::isnan(result.fuel_sum));
  EXPECT_TRUE(std::isnan(result.delta_v_to_settling));
  EXPECT_TRUE(std::isnan(result.delta_v_horizon));
  EXPECT_FALSE(StaysInDomain(result.initial_lyapunov, 0));
  EXPECT_LT(result.momentum_ratio, 1e-3);
  EXPECT_GT(result.inverse_radius, 0.1);
  EXPECT_LT(result.end_time, printed.problem.sampling_period);
  // It asks for some 63 m/s^2 at once.
  EXPECT_GT(result.peak_acceleration * printed.units.acceleration_m_s2(), 60);

  const std::string message = DescribeOutcome(result, printed);
  EXPECT_THAT(message, HasSubstr("left the domain"));
  EXPECT_THAT(message, HasSubstr("at t = "));
  EXPECT_THAT(message, HasSubstr("the angular momentum reached zero"));
}

TEST(ScalarSimulatorTest, BeginningOutsideTheDomainIsLeavingItAtOnce) {
  EpisodeProblem problem = Preset("gto-geo").problem;
  problem.initial_error.x2 = -1;
  const EpisodeResult result = SimulateEpisode(problem, kFirstGains);
  EXPECT_EQ(result.outcome, Outcome::kLeftDomain);
  EXPECT_EQ(result.end_time, 0);
  EXPECT_TRUE(std::isnan(result.cost));
}

TEST(ScalarSimulatorTest, NotSettledWithinAShortHorizon) {
  PreparedScenario scenario = Preset("gto-geo");
  const std::vector<EpisodeSample> whole = Trajectory(scenario.problem, kFirstGains);
  scenario.problem.horizon_samples = 20;
  const EpisodeResult result = SimulateEpisode(scenario.problem, kFirstGains, {.measure_effort = true});
  EXPECT_EQ(result.outcome, Outcome::kNotSettled);
  EXPECT_TRUE(HasCost(result.outcome));
  EXPECT_EQ(result.settling_samples, 20);
  EXPECT_EQ(result.fuel_sum, ControlSum(scenario.problem, whole, 20));
  EXPECT_EQ(result.cost, 20 + 50 * result.fuel_sum);
  EXPECT_EQ(result.delta_v_to_settling, result.delta_v_horizon);
  EXPECT_EQ(result.end_time, 20 * scenario.problem.sampling_period);
  EXPECT_THAT(DescribeOutcome(result, scenario), HasSubstr("not settled within the horizon of 20 samples (54000 s)"));
}

// Inside up to H - 1 but outside at H: there is no k with y(j) <= epsilon from k to H, so Hc = H.
TEST(ScalarSimulatorTest, OutsideAtTheVeryLastSampleIsNotSettled) {
  EpisodeProblem problem = Preset("gto-geo").problem;
  const std::vector<EpisodeSample> whole = Trajectory(problem, kFirstGains);
  const double distance[] = {whole[4].distance, whole[5].distance};
  ASSERT_LT(distance[0], distance[1]) << "the chaser still swings out there";
  problem.settling_distance = (distance[0] + distance[1]) / 2;
  problem.horizon_samples = 5;
  const EpisodeResult result = SimulateEpisode(problem, kFirstGains, {.measure_effort = true});
  EXPECT_EQ(result.outcome, Outcome::kNotSettled);
  EXPECT_EQ(result.settling_samples, 5);
  EXPECT_EQ(result.fuel_sum, ControlSum(problem, whole, 5));
  EXPECT_EQ(result.cost, 5 + 50 * result.fuel_sum);
  EXPECT_EQ(result.delta_v_to_settling, result.delta_v_horizon);
}

TEST(ScalarSimulatorTest, OnTheTargetCostsNothing) {
  EpisodeProblem problem = Preset("gto-geo").problem;
  problem.initial_error = {};
  for (const bool early_exit : {true, false}) {
    const EpisodeResult result =
        SimulateEpisode(problem, kFirstGains, {.early_exit = early_exit, .measure_effort = true});
    EXPECT_EQ(result.outcome, Outcome::kSettled);
    EXPECT_EQ(result.settling_samples, 0);
    EXPECT_EQ(result.cost, 0);
    EXPECT_EQ(result.delta_v_to_settling, 0);
    EXPECT_EQ(result.end_time, early_exit ? 0 : 1280 * problem.sampling_period);
  }
}

TEST(ScalarSimulatorTest, TooManyStepsAreANumericalFailure) {
  PreparedScenario scenario = Preset("gto-geo");
  scenario.problem.horizon_samples = 4;
  Gains stiff = kFirstGains;
  stiff[4] = 1e6;
  const EpisodeResult result = SimulateEpisode(scenario.problem, stiff);
  EXPECT_EQ(result.outcome, Outcome::kNumericalFailure);
  EXPECT_TRUE(std::isnan(result.cost));
  EXPECT_GT(result.momentum_ratio, 0.1);
  EXPECT_THAT(DescribeOutcome(result, scenario), HasSubstr("the integration failed at t = "));
}

TEST(ScalarSimulatorTest, CancelledEndsAtTheNextSampleWithoutACost) {
  const EpisodeProblem problem = Preset("gto-geo").problem;
  int asked = 0;
  EpisodeOptions options;
  options.cancelled = [&] { return ++asked > 3; };
  const EpisodeResult result = SimulateEpisode(problem, kFirstGains, options);
  EXPECT_EQ(result.outcome, Outcome::kNumericalFailure);
  EXPECT_TRUE(std::isnan(result.cost));
  EXPECT_EQ(result.end_time, 3 * problem.sampling_period);
}

// An independent quadrature of ||u||: Simpson's rule over sixteen times as many samples.
TEST(ScalarSimulatorTest, DeltaVIsTheIntegralOfTheControl) {
  for (const char* id : {"gto-geo", "leo-rendezvous"}) {
    EpisodeProblem problem = Preset(id).problem;
    const EpisodeResult result = SimulateEpisode(problem, kTunedGains, {.early_exit = false, .measure_effort = true});
    ASSERT_EQ(result.outcome, Outcome::kSettled);
    constexpr int kFiner = 64;
    problem.sampling_period /= kFiner;
    problem.horizon_samples *= kFiner;
    const std::vector<EpisodeSample> samples = Trajectory(problem, kTunedGains);
    const auto simpson = [&](std::size_t end) {
      double sum = 0;
      for (std::size_t k = 0; k <= end; ++k) {
        sum += samples[k].control.norm() * (k == 0 || k == end ? 1 : k % 2 == 1 ? 4 : 2);
      }
      return sum * problem.sampling_period / 3;
    };
    EXPECT_NEAR(result.delta_v_horizon / simpson(samples.size() - 1), 1, 1e-5) << id;
    const auto settled = static_cast<std::size_t>(kFiner * result.settling_samples);
    EXPECT_NEAR(result.delta_v_to_settling / simpson(settled), 1, 1e-5) << id;
    const double peak =
        std::ranges::max_element(samples, {}, [](const EpisodeSample& s) { return s.control.norm(); })->control.norm();
    EXPECT_NEAR(result.peak_acceleration / peak, 1, 0.02) << id;
  }
}

TEST(ScalarSimulatorTest, TrajectoryHasEverySampleToTheHorizon) {
  const EpisodeProblem problem = Preset("leo-rendezvous").problem;
  const std::vector<EpisodeSample> trajectory = Trajectory(problem, kFirstGains);
  ASSERT_EQ(trajectory.size(), 1281u);
  for (std::size_t k = 0; k < trajectory.size(); ++k) {
    const EpisodeSample& sample = trajectory[k];
    ASSERT_EQ(sample.sample, static_cast<int>(k));
    // A circular target: L_r = L_r(0) + t.
    const double time = static_cast<double>(k) * problem.sampling_period;
    ASSERT_NEAR(sample.target_longitude, problem.target.initial_longitude + time, 1e-9 * (1 + time));
    const TargetPhase phase = problem.target.PhaseAt(sample.target_longitude);
    const LawValue law = EvaluateLaw(sample.error, problem.target, phase, ToCanonical(kFirstGains, problem.gain_units));
    ASSERT_EQ(sample.control.norm(), law.u.norm());
    ASSERT_EQ(sample.lyapunov, law.lyapunov);
    ASSERT_EQ(sample.distance, Distance(sample.error, problem.target, phase));
  }
}

// Between two samples the held control moves x by the same rates: a plain Runge-Kutta of many small steps.
TEST(ZeroOrderHoldTest, HoldsTheControlOfTheSample) {
  EpisodeProblem problem = Preset("gto-geo").problem;
  problem.hold = ControlHold::kZeroOrder;
  const std::vector<EpisodeSample> trajectory = Trajectory(problem, kTunedGains);
  using Vector = Eigen::Matrix<double, 7, 1>;  // x and L_r
  const auto error = [](const Vector& y) { return ErrorState{y[0], y[1], y[2], y[3], y[4], y[5]}; };
  for (const std::size_t k : {0u, 1u, 7u}) {
    const ErrorState& x = trajectory[k].error;
    const Control& u = trajectory[k].control;
    const auto rates = [&](const Vector& y) {
      const TargetPhase phase = problem.target.PhaseAt(y[6]);
      const ErrorState d = ErrorRates(error(y), problem.target, phase, u);
      return Vector{d.x1, d.x2, d.x3, d.x4, d.x5, d.x6, TargetOrbit::LongitudeRate(phase)};
    };
    Vector y{x.x1, x.x2, x.x3, x.x4, x.x5, x.x6, trajectory[k].target_longitude};
    const int steps = 500;
    const double h = problem.sampling_period / steps;
    for (int i = 0; i < steps; ++i) {
      const Vector k1 = rates(y), k2 = rates(y + h / 2 * k1), k3 = rates(y + h / 2 * k2), k4 = rates(y + h * k3);
      y += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    }
    const ErrorState& next = trajectory[k + 1].error;
    const Vector arrived{next.x1, next.x2, next.x3, next.x4, next.x5, next.x6, trajectory[k + 1].target_longitude};
    EXPECT_LT((arrived - y).norm(), 1e-8) << "from sample " << k;
  }
}

// With the sampling period the hold's effect goes to zero, and in proportion to it.
TEST(ZeroOrderHoldTest, ConvergesToTheContinuousControl) {
  const EpisodeProblem continuous = Preset("gto-geo").problem;
  const ErrorState expected = Trajectory(continuous, kTunedGains).at(8).error;
  std::vector<double> difference;
  for (const int finer : {1, 4, 16, 64}) {
    EpisodeProblem held = continuous;
    held.hold = ControlHold::kZeroOrder;
    held.sampling_period /= finer;
    held.horizon_samples = 8 * finer;
    const ErrorState x = Trajectory(held, kTunedGains).back().error;
    difference.push_back(std::hypot(std::hypot(x.x1 - expected.x1, x.x2 - expected.x2, x.x3 - expected.x3),
                                    std::hypot(x.x4 - expected.x4, x.x5 - expected.x5, x.x6 - expected.x6)));
  }
  EXPECT_GT(difference[0], 1e-3);
  EXPECT_NEAR(difference[1] / difference[2], 4, 0.5);
  EXPECT_NEAR(difference[2] / difference[3], 4, 0.25);
}

// Nothing is proved for a held control, so that the early exit must not be taken.
TEST(ZeroOrderHoldTest, NeverStopsEarly) {
  EpisodeProblem problem = Preset("gto-geo").problem;
  const EpisodeResult continuous = SimulateEpisode(problem, kTunedGains);
  ASSERT_LT(continuous.end_time, problem.horizon_samples * problem.sampling_period) << "nothing to compare with";
  problem.hold = ControlHold::kZeroOrder;
  const EpisodeResult held = SimulateEpisode(problem, kTunedGains, {.early_exit = true});
  EXPECT_EQ(held.outcome, Outcome::kSettled);
  EXPECT_EQ(held.end_time, problem.horizon_samples * problem.sampling_period);
  EXPECT_EQ(held.cost, SimulateEpisode(problem, kTunedGains, {.early_exit = false}).cost);
  EXPECT_NE(held.cost, continuous.cost);
}

}  // namespace
}  // namespace orbitune
