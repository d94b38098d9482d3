// The paper's figure 2 (docs/model.md, section 7): ARS takes some 82 % off the cost of gto-geo, and nearly all of it in
// under 1,000 iterations, whatever the seed.
#include <gtest/gtest.h>

#include <algorithm>

#include "core/scenario/presets.h"
#include "core/search/optimiser.h"
#include "core/simd/batch_simulator.h"
#include "tests/core/testing.h"

namespace orbitune {
namespace {

#ifdef ORBITUNE_SANITIZED
constexpr int kSeeds = 2, kIterations = 40;
constexpr double kReduction = 0.05;
#else
constexpr int kSeeds = 5, kIterations = 2000;
constexpr double kReduction = 0.80;
#endif

// J(K(i)) of every iteration, i from 1.
std::vector<double> Costs(const EpisodeProblem& problem, const SearchOptions& options) {
  std::vector<double> costs;
  const auto evaluate = [&](std::span<const Gains> gains, std::span<EpisodeResult> results) {
    std::vector<BatchEpisode> episodes;
    for (const Gains& k : gains) episodes.push_back({.problem = &problem, .gains = k});
    SimulateBatch(episodes, results);
  };
  const absl::Status status = RunSearch(options, evaluate, [&](const IterationRecord& record) {
    EXPECT_EQ(record.outcome, Outcome::kSettled);
    EXPECT_EQ(record.pairs_left_out, 0);
    costs.push_back(record.cost);
  });
  EXPECT_TRUE(status.ok()) << status;
  return costs;
}

TEST(GtoGeoSearchTest, EverySeedReachesTheReduction) {
  const Scenario& scenario = *FindPreset("gto-geo");
  const EpisodeProblem problem = Prepare(scenario)->problem;
  testing::ParallelFor(kSeeds, [&](int i) {
    SearchOptions options = scenario.search;
    options.iterations = kIterations;
    options.seed = static_cast<std::uint64_t>(i) + 1;
    const std::vector<double> costs = Costs(problem, options);
    ASSERT_EQ(costs.size(), static_cast<std::size_t>(kIterations));
    EXPECT_NEAR(costs[0], 812.628, 5e-4);
    const double reduction = 1 - costs.back() / costs[0];
    EXPECT_GE(reduction, kReduction) << "seed " << options.seed;
    const double halfway = 1 - *std::min_element(costs.begin(), costs.begin() + kIterations / 2) / costs[0];
    if (kIterations == 2000) {
      EXPECT_GE(halfway, 0.95 * reduction) << "seed " << options.seed;
    }
  });
}

}  // namespace
}  // namespace orbitune
