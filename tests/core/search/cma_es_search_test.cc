// The figures that CMA-ES is chosen for, on fewer initial conditions than the README's.
#include <gtest/gtest.h>

#include <algorithm>

#include "core/scenario/presets.h"
#include "core/search/ensemble_search.h"
#include "core/simd/batch_simulator.h"

namespace orbitune {
namespace {

std::vector<EpisodeProblem> DrawProblems(const Scenario& scenario, DrawSet set, std::uint32_t count) {
  std::vector<EpisodeProblem> problems;
  const auto states = DrawMany(scenario.neighbourhood, 7, set, 0, count);
  EXPECT_TRUE(states.ok()) << states.status();
  for (const OrbitState& state : *states) problems.push_back(Prepare(scenario, state)->problem);
  return problems;
}

SearchOptions CmaEsOf(const Scenario& scenario, std::int64_t max_episodes) {
  SearchOptions options = scenario.search;
  options.algorithm = Algorithm::kCmaEs;
  options.max_episodes = max_episodes;
  return options;
}

IterationRecord Tune(const SearchOptions& options, const Objective& objective,
                     const std::vector<EpisodeProblem>& problems) {
  EnsembleSearch search(options, objective, problems.size());
  IterationRecord best;
  while (!search.done()) {
    std::vector<BatchEpisode> episodes;
    for (std::size_t e = 0; e < search.episodes(); ++e) {
      episodes.push_back({.problem = &problems[search.initial_condition(e)], .gains = search.gains(e)});
    }
    std::vector<EpisodeResult> results(episodes.size());
    SimulateBatch(episodes, results);
    const auto record = search.Update(results);
    EXPECT_TRUE(record.ok()) << record.status();
    if (record->iteration == 1 || Better(*record, best)) best = *record;
  }
  return best;
}

double ReductionPercent(const Scenario& scenario, const EpisodeProblem& problem, const Gains& gains) {
  const BatchEpisode episodes[] = {{&problem, scenario.search.initial_gains}, {&problem, gains}};
  EpisodeResult results[2];
  SimulateBatch(episodes, results);
  EXPECT_EQ(results[1].outcome, Outcome::kSettled);
  return 100 * (1 - results[1].cost / results[0].cost);
}

double MeanReductionPercent(const char* preset, std::uint32_t count, std::int64_t budget) {
  const Scenario& scenario = *FindPreset(preset);
  double sum = 0;
  for (const EpisodeProblem& problem : DrawProblems(scenario, DrawSet::kTuning, count)) {
    sum += ReductionPercent(scenario, problem, Tune(CmaEsOf(scenario, budget), {}, {problem}).gains);
  }
  return sum / count;
}

TEST(CmaEsSearchTest, LeoRendezvous) { EXPECT_GE(MeanReductionPercent("leo-rendezvous", 8, 6000), 88); }

TEST(CmaEsSearchTest, GtoGeoIsNoWorseThanThePapersArs) { EXPECT_GE(MeanReductionPercent("gto-geo", 4, 6000), 78); }

// One K for all, as good on initial conditions that it has not seen.
TEST(CmaEsSearchTest, ARobustKHoldsOnOthers) {
  const Scenario& scenario = *FindPreset("leo-rendezvous");
  const auto tuned_on = DrawProblems(scenario, DrawSet::kTuning, 16);
  const Gains robust = Tune(CmaEsOf(scenario, 16 * 800), {.relative_to_initial = true}, tuned_on).gains;
  const auto held_out = DrawProblems(scenario, DrawSet::kHeldOut, 60);
  double sum = 0;
  for (const EpisodeProblem& problem : held_out) sum += ReductionPercent(scenario, problem, robust);
  EXPECT_GE(sum / 60, 81);
}

}  // namespace
}  // namespace orbitune
