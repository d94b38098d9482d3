// The lane kernel against the scalar simulator, and against itself: the same bits whatever the batch and the target.
#include "core/simd/batch_simulator.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <tuple>

#include "core/scenario/presets.h"
#include "core/sim/scalar_simulator.h"
#include "core/simd/lane_kernel.h"
#include "tests/core/testing.h"

namespace orbitune {
namespace {

using testing::DrawEpisode;
using testing::RandomEpisode;
using testing::SameBits;

std::vector<RandomEpisode> Draw(int count, int first = 0) {
  std::vector<RandomEpisode> drawn;
  for (int i = 0; i < count; ++i) drawn.push_back(DrawEpisode(first + i));
  return drawn;
}

std::vector<EpisodeResult> Simulate(const std::vector<RandomEpisode>& drawn, bool early_exit = true) {
  std::vector<BatchEpisode> episodes;
  for (const RandomEpisode& e : drawn) {
    episodes.push_back({.problem = &e.problem, .gains = e.gains, .early_exit = early_exit});
  }
  std::vector<EpisodeResult> results(episodes.size());
  SimulateBatch(episodes, results);
  return results;
}

void ExpectSameBits(const EpisodeResult& a, const EpisodeResult& b, int number) {
  EXPECT_EQ(a.outcome, b.outcome) << number;
  EXPECT_EQ(a.settling_samples, b.settling_samples) << number;
  EXPECT_TRUE(SameBits(a.fuel_sum, b.fuel_sum)) << number << ": " << a.fuel_sum << " " << b.fuel_sum;
  EXPECT_TRUE(SameBits(a.cost, b.cost)) << number << ": " << a.cost << " " << b.cost;
  EXPECT_TRUE(SameBits(a.end_time, b.end_time)) << number;
  EXPECT_EQ(a.steps, b.steps) << number;
}

// Every test runs on each instruction set of this machine.
class BatchSimulator : public ::testing::TestWithParam<std::string> {
 protected:
  void SetUp() override { ASSERT_TRUE(simd::UseTarget(GetParam())); }
  void TearDown() override { simd::UseTarget("auto"); }
};

INSTANTIATE_TEST_SUITE_P(Targets, BatchSimulator, ::testing::ValuesIn(simd::SupportedTargets()),
                         [](const auto& target) { return target.param; });

TEST_P(BatchSimulator, AgreesWithTheScalarSimulator) {
  auto drawn = Draw(testing::Cases(400));
  for (const auto& [tolerance, of_cost, of_fuel] :
       {std::tuple(kDefaultIntegrationTolerance, 1e-5, 3e-5), std::tuple(1e-9, 1e-6, 1e-6)}) {
    for (auto& episode : drawn) episode.problem.tolerance = tolerance;
    const auto lanes = Simulate(drawn);
    int settled = 0;
    int left = 0;
    for (std::size_t i = 0; i < drawn.size(); ++i) {
      const EpisodeResult scalar = SimulateEpisode(drawn[i].problem, drawn[i].gains);
      ASSERT_EQ(lanes[i].outcome, scalar.outcome) << i;
      EXPECT_NEAR(lanes[i].initial_lyapunov, scalar.initial_lyapunov, 1e-12 * (1 + scalar.initial_lyapunov)) << i;
      if (!HasCost(scalar.outcome)) {
        ++left;
        EXPECT_NEAR(lanes[i].end_time, scalar.end_time, 1e-3 * (1 + scalar.end_time)) << i;
        continue;
      }
      ++settled;
      EXPECT_EQ(lanes[i].settling_samples, scalar.settling_samples) << i;
      EXPECT_NEAR(lanes[i].cost, scalar.cost, of_cost * scalar.cost) << i;
      EXPECT_NEAR(lanes[i].fuel_sum, scalar.fuel_sum, of_fuel * scalar.fuel_sum) << i;
    }
    EXPECT_GT(settled, 3 * left);
    EXPECT_TRUE(left > 0 || drawn.size() < 400);
  }
}

// A settling distance just below or above that of a sample: by less than what the search's tolerance makes of it.
TEST_P(BatchSimulator, ASampleNearTheSettlingDistanceIsOnItsRightSide) {
  const auto drawn = Draw(testing::Cases(100), 20'000);
  std::vector<RandomEpisode> near;
  std::vector<int> settling;
  for (RandomEpisode episode : drawn) {
    std::vector<EpisodeSample> trajectory;
    EpisodeProblem fine = episode.problem;
    fine.tolerance = 1e-11;
    const EpisodeResult result = SimulateEpisode(fine, episode.gains, {.trajectory = &trajectory});
    if (result.outcome != Outcome::kSettled || result.settling_samples == 0) continue;
    const double last = trajectory[static_cast<std::size_t>(result.settling_samples) - 1].distance;
    for (const double factor : {1 - 1e-7, 1 + 1e-7, 1 - 1e-8, 1 + 1e-8}) {
      episode.problem.settling_distance = fine.settling_distance = factor * last;
      near.push_back(episode);
      settling.push_back(SimulateEpisode(fine, episode.gains).settling_samples);
    }
  }
  const auto lanes = Simulate(near);
  int other = 0;
  for (std::size_t i = 0; i < near.size(); ++i) {
    EXPECT_EQ(lanes[i].outcome, Outcome::kSettled) << i;
    EXPECT_EQ(lanes[i].settling_samples, settling[i]) << i;
    other += i % 2 == 1 && settling[i] != settling[i - 1];
  }
  EXPECT_GT(other, static_cast<int>(drawn.size()) / 2);
}

TEST_P(BatchSimulator, AnEpisodeDoesNotDependOnItsBatch) {
  const std::size_t width = simd::LaneCount();
  const auto drawn = Draw(static_cast<int>(3 * width + 1));
  const auto together = Simulate(drawn);
  for (const std::size_t n : {std::size_t{1}, width - 1, width, width + 1, 2 * width, 2 * width + 1}) {
    const std::size_t count = std::min(std::max<std::size_t>(n, 1), drawn.size());
    const auto part = Simulate({drawn.begin(), drawn.begin() + static_cast<std::ptrdiff_t>(count)});
    for (std::size_t i = 0; i < count; ++i) ExpectSameBits(part[i], together[i], static_cast<int>(i));
  }
  const auto reversed = Simulate({drawn.rbegin(), drawn.rend()});
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    ExpectSameBits(reversed[drawn.size() - 1 - i], together[i], static_cast<int>(i));
  }
}

TEST_P(BatchSimulator, TheEarlyExitChangesNoBitOfTheCost) {
  const auto drawn = Draw(testing::Cases(200), 1000);
  const auto early = Simulate(drawn, true);
  const auto whole = Simulate(drawn, false);
  std::int64_t early_steps = 0;
  std::int64_t whole_steps = 0;
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    EXPECT_EQ(early[i].outcome, whole[i].outcome) << i;
    EXPECT_EQ(early[i].settling_samples, whole[i].settling_samples) << i;
    EXPECT_TRUE(SameBits(early[i].cost, whole[i].cost)) << i;
    early_steps += early[i].steps;
    whole_steps += whole[i].steps;
  }
  EXPECT_LT(early_steps, whole_steps);
}

TEST_P(BatchSimulator, KnowsEveryOutcome) {
  const Scenario* gto = FindPreset("gto-geo");
  const auto prepared = *Prepare(*gto);
  EpisodeProblem short_horizon = prepared.problem;
  short_horizon.horizon_samples = 100;
  EpisodeProblem held = prepared.problem;
  held.hold = ControlHold::kZeroOrder;
  const auto printed = *Prepare(*FindPreset("gto-geo-printed"));
  const Gains k = gto->search.initial_gains;
  const std::vector<BatchEpisode> batch = {{&short_horizon, k},
                                           {&printed.problem, k},
                                           {&prepared.problem, {1, 1e5, 1, 1, 1}},
                                           {&held, k},
                                           {&prepared.problem, k}};
  std::vector<EpisodeResult> results(batch.size());
  SimulateBatch(batch, results);
  EXPECT_EQ(results[0].outcome, Outcome::kNotSettled);
  EXPECT_EQ(results[0].settling_samples, 100);
  EXPECT_EQ(results[0].cost, 100 + short_horizon.fuel_weight * results[0].fuel_sum);
  EXPECT_EQ(results[1].outcome, Outcome::kLeftDomain);
  EXPECT_TRUE(std::isnan(results[1].cost));
  EXPECT_LT(results[1].momentum_ratio, 1e-3);
  EXPECT_EQ(results[2].outcome, Outcome::kNumericalFailure);
  ExpectSameBits(results[3], SimulateEpisode(held, k), 3);
  EXPECT_EQ(results[4].outcome, Outcome::kSettled);
  EXPECT_EQ(results[4].settling_samples, 343);
  EXPECT_NEAR(results[4].cost, 812.6278342, 1e-6 * 812.6);
}

// A batch that would fly for hours ends soon after it is told to, in whatever engine its episodes are.
TEST_P(BatchSimulator, EndsWhenItIsCancelled) {
  const auto prepared = *Prepare(*FindPreset("gto-geo"));
  EpisodeProblem endless = prepared.problem;
  endless.horizon_samples = 7'000'000;
  EpisodeProblem held = endless;
  held.hold = ControlHold::kZeroOrder;
  const Gains k = FindPreset("gto-geo")->search.initial_gains;
  for (const EpisodeProblem* problem : {&endless, &held}) {
    const std::vector<BatchEpisode> batch(300, {.problem = problem, .gains = k, .early_exit = false});
    std::vector<EpisodeResult> results(batch.size());
    int asked = 0;
    EXPECT_TRUE(SimulateBatch(batch, results, [&asked] { return ++asked > 3; }).cancelled);
    EXPECT_GT(asked, 3);
  }
}

TEST_P(BatchSimulator, SaysWhatItMadeOfTheLanes) {
  const auto prepared = *Prepare(*FindPreset("gto-geo"));
  const Gains k = FindPreset("gto-geo")->search.initial_gains;
  const std::size_t full = simd::LaneCount();
  for (const std::size_t count : {full, std::size_t{1}}) {
    const std::vector<BatchEpisode> batch(count, {.problem = &prepared.problem, .gains = k});
    std::vector<EpisodeResult> results(count);
    const BatchUse use = SimulateBatch(batch, results, [] { return false; });
    EXPECT_FALSE(use.cancelled);
    const std::int64_t attempts = results[0].steps + results[0].rejected_steps;
    EXPECT_EQ(use.used_lane_steps, attempts * static_cast<std::int64_t>(count));
    EXPECT_EQ(use.lane_steps, attempts * static_cast<std::int64_t>(full));  // equal episodes end together
  }
}

TEST(BatchSimulatorTargets, ThoseWithAFusedMultiplyAddGiveTheSameBits) {
  const auto drawn = Draw(testing::Cases(300), 5000);
  std::vector<std::vector<EpisodeResult>> fused;
  std::vector<EpisodeResult> baseline;
  for (const std::string& target : simd::SupportedTargets()) {
    ASSERT_TRUE(simd::UseTarget(target));
    EXPECT_EQ(simd::TargetInUse(), target);
    (target == "baseline" ? baseline : fused.emplace_back()) = Simulate(drawn);
  }
  simd::UseTarget("auto");
  EXPECT_EQ(simd::TargetInUse(), simd::SupportedTargets().front());
  for (const auto& results : fused) {
    for (std::size_t i = 0; i < drawn.size(); ++i) ExpectSameBits(results[i], fused[0][i], static_cast<int>(i));
  }
  // Where nothing can be fused the difference is one of rounding (docs/adr/0002-floating-point.md).
  for (std::size_t i = 0; !fused.empty() && i < drawn.size(); ++i) {
    ASSERT_EQ(baseline[i].outcome, fused[0][i].outcome) << i;
    if (!HasCost(baseline[i].outcome)) continue;
    EXPECT_EQ(baseline[i].settling_samples, fused[0][i].settling_samples) << i;
    EXPECT_NEAR(baseline[i].cost, fused[0][i].cost, 1e-7 * fused[0][i].cost) << i;
  }
}

TEST(BatchSimulatorTargets, AnUnknownOneIsRefused) {
  const std::string before = simd::TargetInUse();
  EXPECT_FALSE(simd::UseTarget("avx3000"));
  EXPECT_EQ(simd::TargetInUse(), before);
}

}  // namespace
}  // namespace orbitune
