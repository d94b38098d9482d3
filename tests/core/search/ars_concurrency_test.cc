// A search over real episodes, whose batches are split over threads: the split must not show.
#include <gtest/gtest.h>

#include "core/scenario/presets.h"
#include "core/search/optimiser.h"
#include "core/sim/scalar_simulator.h"
#include "tests/core/testing.h"

namespace orbitune {
namespace {

std::vector<IterationRecord> Search(const Evaluate& evaluate) {
  SearchOptions options = FindPreset("leo-rendezvous")->search;
  options.iterations = testing::kFewer > 1 ? 3 : 12;
  std::vector<IterationRecord> records;
  EXPECT_TRUE(RunSearch(options, evaluate, [&](const IterationRecord& record) { records.push_back(record); }).ok());
  return records;
}

TEST(ArsConcurrencyTest, SplittingABatchOverThreadsChangesNothing) {
  const EpisodeProblem problem = Prepare(*FindPreset("leo-rendezvous"))->problem;
  const auto in_order = Search([&](std::span<const Gains> gains, std::span<EpisodeResult> results) {
    for (std::size_t j = 0; j < gains.size(); ++j) results[j] = SimulateEpisode(problem, gains[j]);
  });
  const auto split = Search([&](std::span<const Gains> gains, std::span<EpisodeResult> results) {
    testing::ParallelFor(static_cast<int>(gains.size()), [&](int j) {
      const auto i = static_cast<std::size_t>(j);
      results[i] = SimulateEpisode(problem, gains[i]);
    });
  });
  ASSERT_EQ(in_order.size(), split.size());
  for (std::size_t i = 0; i < split.size(); ++i) EXPECT_TRUE(Identical(in_order[i], split[i])) << "record " << i;
  EXPECT_LT(split.back().cost, split.front().cost);
}

}  // namespace
}  // namespace orbitune
