// What every optimiser has to do, whatever its algorithm.
#include "core/search/optimiser.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/search/ensemble_search.h"

namespace orbitune {
namespace {

using ::testing::HasSubstr;

constexpr Gains kOptimum{0.7, 0.2, 0.8, 0.75, 3};

// Least, 10, at kOptimum, with axes of different lengths that are not the gains'.
double Cost(const Gains& k) {
  double cost = 10;
  for (std::size_t i = 0; i < k.size(); ++i) {
    const double along = std::log(k[i] / kOptimum[i]) + 0.3 * std::log(k[(i + 1) % 5] / kOptimum[(i + 1) % 5]);
    cost += static_cast<double>(i + 1) * along * along;
  }
  return cost;
}

EpisodeResult Settled(double cost) {
  return {.outcome = Outcome::kSettled, .settling_samples = 3, .fuel_sum = cost / 7, .cost = cost};
}

// Some candidates leave the domain or do not settle, where the gains say so.
EpisodeResult Fly(const Gains& k) {
  if (k[0] > 4) return {.outcome = Outcome::kLeftDomain};
  EpisodeResult result = Settled(Cost(k));
  if (k[4] > 12) result.outcome = Outcome::kNotSettled;
  return result;
}

void Evaluate(std::span<const Gains> gains, std::span<EpisodeResult> results) {
  for (std::size_t j = 0; j < gains.size(); ++j) results[j] = Fly(gains[j]);
}

bool SameOrBothNan(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

struct Case {
  const char* name;
  SearchOptions options;
};

void PrintTo(const Case& c, std::ostream* os) { *os << c.name; }

SearchOptions With(Algorithm algorithm) {
  SearchOptions options{.iterations = 60, .seed = 11};
  options.algorithm = algorithm;
  return options;
}

std::vector<Case> Cases() {
  std::vector<Case> cases;
  SearchOptions ars{.iterations = 60, .step_size = 0.05, .exploration_scale = 0.02, .directions = 6, .seed = 11};
  cases.push_back({"Ars", ars});
  ars.plateau_stop = {.iterations = 20, .min_improvement = 1e-9};
  cases.push_back({"ArsWithPlateau", ars});
  ars.ars_variants = {.top_directions = 2,
                      .step_schedule = Schedule::kInverseSqrt,
                      .exploration_schedule = Schedule::kLinear,
                      .log_gains = true};
  ars.exploration_std = ars.initial_gains;  // alike for every ln K
  cases.push_back({"ArsVariants", ars});
  SearchOptions cma_es = With(Algorithm::kCmaEs);
  cases.push_back({"CmaEs", cma_es});
  cma_es.cma_es = {.population = 6, .initial_sigma = 0.7, .restarts = 2, .population_growth = 2};
  cma_es.max_episodes = 400;
  cma_es.plateau_stop = {.iterations = 30, .min_improvement = 1e-6};
  cases.push_back({"CmaEsWithRestarts", cma_es});
  SearchOptions simplex = With(Algorithm::kNelderMead);
  simplex.iterations = 200;
  cases.push_back({"NelderMead", simplex});
  return cases;
}

std::vector<IterationRecord> History(const SearchOptions& options) {
  std::vector<IterationRecord> records;
  const absl::Status status =
      RunSearch(options, &Evaluate, [&](const IterationRecord& record) { records.push_back(record); });
  EXPECT_TRUE(status.ok()) << status;
  return records;
}

class OptimiserTest : public ::testing::TestWithParam<Case> {};

TEST_P(OptimiserTest, BeginsWithTheInitialGains) {
  const auto search = MakeOptimiser(GetParam().options);
  ASSERT_FALSE(search->done());
  EXPECT_EQ(search->batch()[0], GetParam().options.initial_gains);
  const IterationRecord first = History(GetParam().options).front();
  EXPECT_EQ(first.gains, GetParam().options.initial_gains);
  EXPECT_EQ(first.cost, Cost(first.gains));
}

TEST_P(OptimiserTest, CountsIterationsAndEpisodes) {
  const auto search = MakeOptimiser(GetParam().options);
  std::int64_t flown = 0;
  for (int i = 1; !search->done(); ++i) {
    std::vector<EpisodeResult> results(search->batch().size());
    flown += std::ssize(results);
    Evaluate(search->batch(), results);
    const auto record = search->Update(results);
    ASSERT_TRUE(record.ok());
    ASSERT_EQ(record->iteration, i);
    ASSERT_EQ(record->episodes, flown);
  }
}

TEST_P(OptimiserTest, IsAFunctionOfItsOptions) {
  const auto one = History(GetParam().options), other = History(GetParam().options);
  ASSERT_EQ(one.size(), other.size());
  for (std::size_t i = 0; i < one.size(); ++i) ASSERT_TRUE(Identical(one[i], other[i])) << "iteration " << i + 1;
  if (GetParam().options.algorithm == Algorithm::kNelderMead) return;  // draws nothing
  SearchOptions another = GetParam().options;
  another.seed = 12;
  EXPECT_FALSE(Identical(History(another)[2], one[2]));
}

// At every iteration, and from the checkpoint that was there when it began.
TEST_P(OptimiserTest, ResumesAnywhereToTheSameBits) {
  const SearchOptions& options = GetParam().options;
  std::vector<IterationRecord> whole;
  std::vector<std::vector<double>> checkpoints;
  const auto step = [](Optimiser& search) {
    std::vector<EpisodeResult> results(search.batch().size());
    Evaluate(search.batch(), results);
    return *search.Update(results);
  };
  for (const auto search = MakeOptimiser(options); !search->done();) {
    checkpoints.push_back(search->checkpoint());
    whole.push_back(step(*search));
  }
  ASSERT_GT(whole.size(), 20u);
  for (std::size_t start = 0; start < whole.size(); ++start) {
    const auto search = MakeOptimiser(options);
    ASSERT_TRUE(search->Resume(whole[start], checkpoints[start]).ok());
    for (std::size_t i = start; i < whole.size(); ++i) {
      ASSERT_TRUE(std::ranges::equal(search->checkpoint(), checkpoints[i], SameOrBothNan));
      ASSERT_TRUE(Identical(step(*search), whole[i])) << "resumed at " << start + 1 << ", iteration " << i + 1;
    }
    EXPECT_TRUE(search->done());
  }
}

TEST_P(OptimiserTest, ADamagedCheckpointIsRefused) {
  const auto search = MakeOptimiser(GetParam().options);
  std::vector<EpisodeResult> results(search->batch().size());
  Evaluate(search->batch(), results);
  std::vector<double> checkpoint = search->checkpoint();
  const auto record = search->Update(results);
  checkpoint.push_back(1);
  EXPECT_TRUE(absl::IsDataLoss(MakeOptimiser(GetParam().options)->Resume(*record, checkpoint)));
}

TEST_P(OptimiserTest, EveryGainSimulatedIsWithinTheBounds) {
  SearchOptions options = GetParam().options;
  options.gain_floor = 0.09;  // a little below K1
  const auto evaluate = [&](std::span<const Gains> gains, std::span<EpisodeResult> results) {
    for (std::size_t j = 0; j < gains.size(); ++j) {
      for (const double k : gains[j]) {
        EXPECT_GE(k, options.gain_floor);
        EXPECT_LE(k, SearchOptions::kMaxGain);
      }
      // Whatever is smaller is better: the floor is where it ends.
      double cost = 10;
      for (const double k : gains[j]) cost += std::log(k / options.gain_floor);
      results[j] = Settled(cost);
    }
  };
  ASSERT_TRUE(RunSearch(options, evaluate, [](const IterationRecord&) {}).ok());
}

TEST_P(OptimiserTest, FindsTheOptimum) {
  SearchOptions options = GetParam().options;
  options.iterations = options.algorithm == Algorithm::kArs ? 4000 : 1000;
  options.max_episodes = 0;
  options.plateau_stop = {};
  options.ars_variants.step_schedule = options.ars_variants.exploration_schedule = Schedule::kConstant;
  double best = std::numeric_limits<double>::infinity();
  for (const IterationRecord& record : History(options)) best = std::fmin(best, record.cost);
  EXPECT_LT(best, options.algorithm == Algorithm::kArs ? 10.1 : 10.0001);
}

TEST_P(OptimiserTest, NeverFliesMoreThanItsBudget) {
  SearchOptions options = GetParam().options;
  options.iterations = 100'000;
  options.plateau_stop = {};
  for (const std::int64_t budget : {40, 41, 97, 300}) {
    options.max_episodes = budget;
    ASSERT_TRUE(CheckBudget(options, 1).ok());
    const auto history = History(options);
    EXPECT_LE(history.back().episodes, budget);
    EXPECT_GT(history.back().episodes, budget - 30);
  }
}

TEST_P(OptimiserTest, EndsAfterItsIterations) {
  SearchOptions options = GetParam().options;
  options.iterations = 7;
  EXPECT_EQ(History(options).size(), 7u);
}

TEST_P(OptimiserTest, EndsOnAPlateau) {
  SearchOptions options = GetParam().options;
  options.plateau_stop = {.iterations = 5, .min_improvement = 0.999};  // nothing counts but the first
  EXPECT_EQ(History(options).size(), 6u);
}

TEST_P(OptimiserTest, FailsWithTheReasonWhereEverythingLeavesTheDomain) {
  const auto evaluate = [](std::span<const Gains>, std::span<EpisodeResult> results) {
    for (EpisodeResult& r : results) r = {.outcome = Outcome::kLeftDomain};
  };
  const absl::Status status = RunSearch(GetParam().options, evaluate, [](const IterationRecord&) {});
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr("left the domain or failed"));
}

INSTANTIATE_TEST_SUITE_P(, OptimiserTest, ::testing::ValuesIn(Cases()),
                         [](const auto& test) { return std::string(test.param.name); });

// Of candidates the record is the best one, and counts those without a cost.
TEST(RecordOfCandidatesTest, IsTheBestOfTheBatch) {
  const std::vector<Gains> batch{{1}, {2}, {3}, {4}};
  std::vector<EpisodeResult> results{Settled(5), Settled(3), {.outcome = Outcome::kLeftDomain}, Settled(1)};
  results[3].outcome = Outcome::kNotSettled;  // worse than any that settled
  const IterationRecord record = RecordOfCandidates(batch, results);
  EXPECT_EQ(record.gains, batch[1]);
  EXPECT_EQ(record.cost, 3);
  EXPECT_EQ(record.pairs_left_out, 1);
  EXPECT_EQ(record.pairs_not_settled, 1);
  EXPECT_NEAR(record.cost_std, std::sqrt(8.0 / 3), 1e-12);  // of 5, 3, 1
}

// A sampling search whose optimum lies on the floor reaches it, and its cloud does not fall apart there.
TEST(CmaEsTest, FindsAnOptimumOnTheFloor) {
  SearchOptions options = With(Algorithm::kCmaEs);
  options.iterations = 300;
  const auto evaluate = [](std::span<const Gains> gains, std::span<EpisodeResult> results) {
    for (std::size_t j = 0; j < gains.size(); ++j) {
      double cost = 10 + 2 * std::log(gains[j][1] / 1e-3);
      for (const std::size_t i : {0u, 2u, 3u, 4u}) cost += std::pow(std::log(gains[j][i] / kOptimum[i]), 2);
      results[j] = Settled(cost);
    }
  };
  IterationRecord best, last;
  ASSERT_TRUE(RunSearch(options, evaluate, [&](const IterationRecord& record) {
                if (record.iteration == 1 || Better(record, best)) best = record;
                last = record;
              }).ok());
  EXPECT_LT(best.gains[1], 2e-3);
  EXPECT_LT(last.cost, best.cost + 1);
}

TEST(ArsVariantsTest, TopDirectionsMoveAlone) {
  SearchOptions options{.iterations = 3, .step_size = 0.05, .exploration_scale = 0.02, .directions = 4, .seed = 5};
  options.ars_variants.top_directions = 1;
  const auto search = MakeOptimiser(options);
  const Gains k = search->batch()[0];
  std::vector<EpisodeResult> results(search->batch().size(), Settled(50));
  results[3] = Settled(20);  // direction 1, the plus side
  results[4] = Settled(40);
  ASSERT_TRUE(search->Update(results).ok());
  // sigma_J of {20, 40} is 10; the step is alpha / (1 * 10) * (40 - 20) delta_1.
  const std::vector<Gains> moved(search->batch().begin(), search->batch().begin() + 1);
  const auto again = MakeOptimiser(options);
  for (std::size_t i = 0; i < kGainCount; ++i) {
    const double delta = (again->batch()[3][i] - k[i]) / options.exploration_scale;
    EXPECT_NEAR(moved[0][i], k[i] + 0.05 / 10 * 20 * delta, 1e-12);
  }
}

TEST(ArsVariantsTest, SchedulesAndLogGainsShapeTheExploration) {
  SearchOptions options{.iterations = 4, .step_size = 0.05, .exploration_scale = 0.02, .directions = 1, .seed = 5};
  const Gains plain = MakeOptimiser(options)->batch()[1];
  options.ars_variants.log_gains = true;
  const Gains logarithmic = MakeOptimiser(options)->batch()[1];
  for (std::size_t i = 0; i < kGainCount; ++i) {
    const double k = options.initial_gains[i];
    EXPECT_NEAR(logarithmic[i], k * std::exp((plain[i] - k) / k), 1e-12);
  }
  // Iteration 3 of 4: the linear schedule leaves a half, the other 1 / sqrt(3).
  options.ars_variants = {};
  const IterationRecord third{.iteration = 3, .gains = options.initial_gains, .episodes = 9};
  const auto width = [&](Schedule schedule) {
    options.ars_variants.exploration_schedule = schedule;
    const auto search = MakeOptimiser(options);
    EXPECT_TRUE(search->Resume(third, {}).ok());
    return search->batch()[1][1] - search->batch()[0][1];
  };
  const double whole = width(Schedule::kConstant);
  EXPECT_NEAR(width(Schedule::kLinear) / whole, 0.5, 1e-9);
  EXPECT_NEAR(width(Schedule::kInverseSqrt) / whole, 1 / std::sqrt(3.0), 1e-9);
}

TEST(SearchOptionsTest, NamesEveryNestedFieldOutOfRange) {
  SearchOptions options;
  options.max_episodes = -1;
  options.plateau_stop = {.iterations = -2, .min_improvement = 1};
  options.ars_variants.top_directions = 17;
  options.cma_es = {.population = 3, .initial_sigma = 0, .restarts = -1, .population_growth = 0.5};
  options.nelder_mead = {.initial_step = std::nan(""), .restarts = 1001};
  std::vector<std::string> faults;
  for (const FieldViolation& v : FieldViolationsOf(options.Validate())) {
    faults.push_back(v.field + " " + v.description);
  }
  EXPECT_EQ(faults, (std::vector<std::string>{
                        "max_episodes must be in [0, 1000000000000], got -1",
                        "plateau_stop.iterations must be in [0, 10000000], got -2",
                        "plateau_stop.min_improvement must be in [0, 1), got 1",
                        "ars_variants.top_directions must be in [0, 16], got 17",
                        "cma_es.population must be in [4, 1024], got 3",
                        "cma_es.restarts must be in [0, 1000], got -1",
                        "cma_es.initial_sigma must be in [1e-6, 5], got 0",
                        "cma_es.population_growth must be in [1, 4], got 0.5",
                        "nelder_mead.initial_step must be in [1e-6, 5], got nan",
                        "nelder_mead.restarts must be in [0, 1000], got 1001",
                    }));
}

}  // namespace
}  // namespace orbitune
