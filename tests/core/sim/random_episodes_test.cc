// What holds for every episode, over random scenarios, initial conditions and gains in [0.03, 30].
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>

#include "core/control/certificate.h"
#include "core/sim/scalar_simulator.h"
#include "tests/core/testing.h"

namespace orbitune {
namespace {

using testing::Cases;
using testing::DrawEpisode;
using testing::ParallelFor;
using testing::RandomEpisode;
using testing::SameBits;

EpisodeResult Simulate(const RandomEpisode& episode, const EpisodeOptions& options = {}) {
  return SimulateEpisode(episode.problem, episode.gains, options);
}

void ExpectSameCost(const EpisodeResult& a, const EpisodeResult& b, int number) {
  EXPECT_EQ(a.outcome, b.outcome) << "episode " << number;
  EXPECT_EQ(a.settling_samples, b.settling_samples) << "episode " << number;
  EXPECT_TRUE(SameBits(a.fuel_sum, b.fuel_sum)) << "episode " << number;
  EXPECT_TRUE(SameBits(a.cost, b.cost)) << "episode " << number << ": " << a.cost << " and " << b.cost;
}

TEST(RandomEpisodesTest, EarlyExitChangesNoBitOfTheCost) {
  std::atomic<int> earlier = 0;
  ParallelFor(Cases(2000), [&](int i) {
    const RandomEpisode episode = DrawEpisode(i);
    const EpisodeResult early = Simulate(episode);
    const EpisodeResult full = Simulate(episode, {.early_exit = false});
    ExpectSameCost(early, full, i);
    if (early.end_time < full.end_time) ++earlier;
  });
  EXPECT_GT(earlier, Cases(2000) / 3) << "too few episodes leave early for this to say anything";
}

// The cost by its definition, from a trajectory; and the options that watch an episode leave it as it is.
TEST(RandomEpisodesTest, CostIsWhatTheDefinitionGivesOfTheSamples) {
  ParallelFor(Cases(500), [](int i) {
    const RandomEpisode episode = DrawEpisode(i);
    const EpisodeProblem& problem = episode.problem;
    std::vector<EpisodeSample> trajectory;
    const EpisodeResult result =
        Simulate(episode, {.early_exit = false, .measure_effort = true, .trajectory = &trajectory});
    ExpectSameCost(result, Simulate(episode), i);
    if (!HasCost(result.outcome)) return;
    const int horizon = problem.horizon_samples;
    ASSERT_EQ(trajectory.size(), static_cast<std::size_t>(horizon) + 1);
    const auto inside = [&](int k) {
      return trajectory[static_cast<std::size_t>(k)].distance <= problem.settling_distance;
    };
    int settling = horizon;  // Hc
    if (inside(horizon)) {
      while (settling > 0 && inside(settling - 1)) --settling;
    }
    double fuel = 0;
    for (int k = 0; k < settling; ++k) {
      fuel += trajectory[static_cast<std::size_t>(k)].control.norm() / problem.gain_units.acceleration;
    }
    EXPECT_EQ(result.outcome, inside(horizon) ? Outcome::kSettled : Outcome::kNotSettled);
    EXPECT_EQ(result.settling_samples, settling);
    EXPECT_EQ(result.fuel_sum, fuel);
    EXPECT_EQ(result.cost, settling + problem.fuel_weight * fuel);
    EXPECT_LE(result.delta_v_to_settling, result.delta_v_horizon);
    EXPECT_GT(result.delta_v_to_settling, 0);
  });
}

TEST(RandomEpisodesTest, LyapunovFunctionNeverRises) {
  ParallelFor(Cases(500), [](int i) {
    const RandomEpisode episode = DrawEpisode(i);
    std::vector<EpisodeSample> trajectory;
    Simulate(episode, {.early_exit = false, .trajectory = &trajectory});
    const double tolerance = episode.problem.tolerance;
    for (std::size_t k = 1; k < trajectory.size(); ++k) {
      // V is quadratic in x, up to K1 / 2 times a square, and x is known to a hundredth of `tolerance`, of its largest
      // component.
      const double before = trajectory[k - 1].lyapunov, after = trajectory[k].lyapunov;
      const double floor = std::pow(1e-2 * episode.problem.settling_distance, 2);
      ASSERT_LE(after, before + 10 * tolerance * (before + floor)) << "episode " << i << " sample " << k;
    }
  });
}

// V(0) < (1 - e_r)^2 / 2 proves that an episode stays in the domain: no outcome may say otherwise.
TEST(RandomEpisodesTest, OutcomesKeepWhatTheCertificatePromises) {
  std::atomic<int> guaranteed = 0, left = 0;
  ParallelFor(Cases(1000), [&](int i) {
    const RandomEpisode episode = DrawEpisode(i);
    const EpisodeResult result = Simulate(episode, {.measure_effort = true});
    EXPECT_EQ(std::isnan(result.cost), !HasCost(result.outcome));
    EXPECT_EQ(std::isnan(result.fuel_sum), !HasCost(result.outcome));
    EXPECT_EQ(std::isnan(result.delta_v_to_settling), !HasCost(result.outcome));
    EXPECT_GT(result.peak_acceleration, 0);
    if (result.outcome == Outcome::kLeftDomain) {
      ++left;
      EXPECT_LT(std::min(result.momentum_ratio, result.inverse_radius), 1e-2) << "episode " << i;
    }
    if (StaysInDomain(result.initial_lyapunov, episode.problem.target.eccentricity())) {
      ++guaranteed;
      EXPECT_NE(result.outcome, Outcome::kLeftDomain) << "episode " << i;
    }
  });
  EXPECT_GT(guaranteed, Cases(1000) / 4);
  EXPECT_GT(left, 0);
}

// Which thread simulates, and what it did before, does not show.
TEST(RandomEpisodesTest, SameBitsEveryTime) {
  constexpr int kEpisodes = Cases(200);
  std::vector<EpisodeResult> in_order(kEpisodes), parallel(kEpisodes);
  for (int i = 0; i < kEpisodes; ++i) in_order[static_cast<std::size_t>(i)] = Simulate(DrawEpisode(i));
  ParallelFor(kEpisodes, [&](int i) {
    const int number = kEpisodes - 1 - i;
    parallel[static_cast<std::size_t>(number)] = Simulate(DrawEpisode(number));
  });
  for (int i = 0; i < kEpisodes; ++i) {
    const EpisodeResult &a = in_order[static_cast<std::size_t>(i)], &b = parallel[static_cast<std::size_t>(i)];
    ExpectSameCost(a, b, i);
    EXPECT_EQ(a.steps, b.steps);
    EXPECT_EQ(a.rejected_steps, b.rejected_steps);
    EXPECT_EQ(a.end_time, b.end_time);
  }
}

TEST(RandomEpisodesTest, DefaultToleranceGivesTheCostToAMillionth) {
  constexpr int kEpisodes = Cases(400);
  std::vector<double> error(kEpisodes);
  ParallelFor(kEpisodes, [&](int i) {
    RandomEpisode episode = DrawEpisode(i);
    const EpisodeResult normal = Simulate(episode);
    episode.problem.tolerance = 1e-12;
    const EpisodeResult fine = Simulate(episode);
    // At a tolerance that fine some episodes need more steps than are allowed.
    if (fine.outcome == Outcome::kNumericalFailure) return;
    EXPECT_EQ(normal.outcome, fine.outcome) << "episode " << i;
    EXPECT_EQ(normal.settling_samples, fine.settling_samples) << "episode " << i;
    if (HasCost(fine.outcome)) error[static_cast<std::size_t>(i)] = std::abs(normal.cost / fine.cost - 1);
  });
  EXPECT_LT(*std::ranges::max_element(error), 1e-6);
  EXPECT_GT(std::ranges::count_if(error, [](double e) { return e > 0; }), kEpisodes / 2);
}

// Ten times the tolerance, some ten times the error: the step size control does its work.
TEST(RandomEpisodesTest, ErrorFallsWithTheTolerance) {
  constexpr int kEpisodes = Cases(100);
  const auto mean_error = [](double tolerance) {
    std::vector<double> log_error(kEpisodes);
    ParallelFor(kEpisodes, [&](int i) {
      RandomEpisode episode = DrawEpisode(i);
      episode.problem.tolerance = 1e-11;
      const EpisodeResult fine = Simulate(episode);
      episode.problem.tolerance = tolerance;
      const EpisodeResult coarse = Simulate(episode);
      const bool comparable = HasCost(fine.outcome) && coarse.settling_samples == fine.settling_samples;
      log_error[static_cast<std::size_t>(i)] =
          comparable ? std::log10(std::abs(coarse.cost / fine.cost - 1) + 1e-16) : 0;
    });
    double sum = 0;
    for (const double e : log_error) sum += e;
    return sum / kEpisodes;
  };
  const double at_1e6 = mean_error(1e-6), at_1e7 = mean_error(1e-7), at_1e8 = mean_error(1e-8);
  EXPECT_LT(at_1e7, at_1e6 - 0.5);
  EXPECT_LT(at_1e8, at_1e7 - 0.5);
}

}  // namespace
}  // namespace orbitune
