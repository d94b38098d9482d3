#include "core/search/objective.h"

#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "core/search/ensemble_search.h"

namespace orbitune {
namespace {

constexpr std::array kCosts{7.0, 1.0, 3.0, 10.0, 2.0, 4.0, 9.0, 5.0, 8.0, 6.0};  // 1 to 10

double Of(Aggregate aggregate, double level) {
  return AggregateCosts({.aggregate = aggregate, .level = level}, kCosts);
}

TEST(AggregateCostsTest, ByHand) {
  EXPECT_DOUBLE_EQ(Of(Aggregate::kMean, 0), 5.5);
  EXPECT_DOUBLE_EQ(Of(Aggregate::kWorst, 0), 10);
  EXPECT_DOUBLE_EQ(Of(Aggregate::kPercentile, 0.9), 9);
  EXPECT_DOUBLE_EQ(Of(Aggregate::kPercentile, 0.91), 10);
  EXPECT_DOUBLE_EQ(Of(Aggregate::kPercentile, 0.01), 1);
  EXPECT_DOUBLE_EQ(Of(Aggregate::kPercentile, 0.7), 7);
  EXPECT_DOUBLE_EQ(Of(Aggregate::kCvar, 0.7), 9);  // of 10, 9, 8
  EXPECT_DOUBLE_EQ(Of(Aggregate::kCvar, 0.75), (10 + 9 + 0.5 * 8) / 2.5);
  EXPECT_DOUBLE_EQ(Of(Aggregate::kCvar, 0.99), 10);
}

TEST(AggregateCostsTest, OfOneCostIsThatCost) {
  const std::array one{42.0};
  for (const Objective& o :
       {Objective{}, Objective{.aggregate = Aggregate::kPercentile, .level = 0.3},
        Objective{.aggregate = Aggregate::kCvar, .level = 0.3}, Objective{.aggregate = Aggregate::kWorst}}) {
    EXPECT_DOUBLE_EQ(AggregateCosts(o, one), 42);
  }
}

TEST(ObjectiveTest, ALevelGoesWithPercentileAndCvarAlone) {
  for (const double level : {0.0, 1.0, -0.1, 1.5}) {
    for (const Aggregate a : {Aggregate::kPercentile, Aggregate::kCvar}) {
      EXPECT_EQ(FieldViolationsOf(Objective{.aggregate = a, .level = level}.Validate()).size(), 1u);
    }
  }
  EXPECT_FALSE((Objective{.aggregate = Aggregate::kMean, .level = 0.5}.Validate().ok()));
  EXPECT_TRUE((Objective{.aggregate = Aggregate::kCvar, .level = 0.5}.Validate().ok()));
}

EpisodeResult Settled(double cost, int samples = 1) {
  return {.outcome = Outcome::kSettled, .settling_samples = samples, .fuel_sum = cost / 10, .cost = cost};
}

TEST(AggregateResultsTest, MeansAndTheWorstOutcome) {
  std::vector<EpisodeResult> results{Settled(10, 4), Settled(30, 7)};
  EpisodeResult all = AggregateResults({}, results, {});
  EXPECT_EQ(all.outcome, Outcome::kSettled);
  EXPECT_DOUBLE_EQ(all.cost, 20);
  EXPECT_DOUBLE_EQ(all.fuel_sum, 2);
  EXPECT_EQ(all.settling_samples, 6);  // 5.5
  const std::vector<double> baselines{20, 300};
  EXPECT_DOUBLE_EQ(AggregateResults({.relative_to_initial = true}, results, baselines).cost, (0.5 + 0.1) / 2);
  results[1].outcome = Outcome::kNotSettled;
  EXPECT_EQ(AggregateResults({}, results, {}).outcome, Outcome::kNotSettled);
  results.push_back({.outcome = Outcome::kNumericalFailure});
  results.push_back({.outcome = Outcome::kLeftDomain});
  all = AggregateResults({}, results, {});
  EXPECT_EQ(all.outcome, Outcome::kLeftDomain);
  EXPECT_TRUE(std::isnan(all.cost));
}

// Initial condition i costs (i + 1) times the distance of K from all ones.
EpisodeResult Fly(const Gains& k, std::size_t i) {
  double cost = 1;
  for (const double gain : k) cost += std::abs(std::log(gain));
  return Settled(static_cast<double>(i + 1) * cost);
}

SearchOptions Options(Algorithm algorithm) {
  SearchOptions options{.iterations = 25, .step_size = 0.05, .exploration_scale = 0.02, .directions = 3};
  options.algorithm = algorithm;
  return options;
}

IterationRecord Step(EnsembleSearch& search) {
  std::vector<EpisodeResult> results;
  for (std::size_t e = 0; e < search.episodes(); ++e) {
    results.push_back(Fly(search.gains(e), search.initial_condition(e)));
  }
  return *search.Update(results);
}

TEST(EnsembleSearchTest, WithOneInitialConditionItIsTheSearchItself) {
  const SearchOptions options = Options(Algorithm::kCmaEs);
  EnsembleSearch search(options, {}, 1);
  const auto plain = MakeOptimiser(options);
  while (!plain->done()) {
    std::vector<EpisodeResult> results;
    for (const Gains& k : plain->batch()) results.push_back(Fly(k, 0));
    ASSERT_TRUE(Identical(Step(search), *plain->Update(results)));
  }
  EXPECT_TRUE(search.done());
}

TEST(EnsembleSearchTest, EveryGainIsFlownFromEveryInitialCondition) {
  EnsembleSearch search(Options(Algorithm::kArs), {.aggregate = Aggregate::kWorst}, 4);
  ASSERT_EQ(search.episodes(), 28u);
  for (std::size_t e = 0; e < 28; ++e) {
    EXPECT_EQ(search.gains(e), search.gains(e - e % 4));
    EXPECT_EQ(search.initial_condition(e), e % 4);
  }
  const IterationRecord record = Step(search);
  EXPECT_DOUBLE_EQ(record.cost, Fly(record.gains, 3).cost);
  EXPECT_EQ(record.episodes, 28);
}

TEST(EnsembleSearchTest, ResumesAnywhereToTheSameBits) {
  for (const Algorithm algorithm : {Algorithm::kArs, Algorithm::kCmaEs, Algorithm::kNelderMead}) {
    const Objective objective{.aggregate = Aggregate::kCvar, .level = 0.5, .relative_to_initial = true};
    EnsembleSearch whole(Options(algorithm), objective, 3);
    std::vector<IterationRecord> records;
    std::vector<std::vector<double>> checkpoints;
    while (!whole.done()) {
      checkpoints.push_back(whole.checkpoint());
      records.push_back(Step(whole));
    }
    EXPECT_DOUBLE_EQ(records[0].cost, 1);  // relative to itself
    for (std::size_t start = 0; start < records.size(); ++start) {
      EnsembleSearch search(Options(algorithm), objective, 3);
      ASSERT_TRUE(search.Resume(records[start], checkpoints[start]).ok());
      for (std::size_t i = start; i < records.size(); ++i) ASSERT_TRUE(Identical(Step(search), records[i])) << i;
      EXPECT_TRUE(search.done());
    }
  }
}

TEST(EnsembleSearchTest, ARelativeCostNeedsOneUnderTheInitialGains) {
  for (const EpisodeResult& bad : {EpisodeResult{.outcome = Outcome::kLeftDomain}, Settled(0)}) {
    EnsembleSearch search(Options(Algorithm::kCmaEs), {.relative_to_initial = true}, 2);
    const std::vector<EpisodeResult> results{Settled(3), bad};
    const auto record = search.Update(results);
    EXPECT_TRUE(absl::IsFailedPrecondition(record.status()));
    EXPECT_NE(record.status().message().find("initial condition 1"), absl::string_view::npos) << record.status();
    EXPECT_EQ(search.iteration(), 1);
  }
}

TEST(EnsembleSearchTest, TheBudgetCountsEveryEpisode) {
  SearchOptions options = Options(Algorithm::kCmaEs);
  options.iterations = 1000;
  options.max_episodes = 200;
  EnsembleSearch search(options, {}, 5);
  IterationRecord last;
  while (!search.done()) last = Step(search);
  EXPECT_EQ(last.episodes, 5 * (1 + 2 * 16));  // one more generation would be 245
  EXPECT_TRUE(CheckBudget(options, 11).ok());
  EXPECT_FALSE(CheckBudget(options, 12).ok());
  EXPECT_EQ(FieldViolationsOf(CheckBudget(options, 12)).at(0).description,
            "must be at least 204, the first batches of the search, or 0, got 200");
}

}  // namespace
}  // namespace orbitune
