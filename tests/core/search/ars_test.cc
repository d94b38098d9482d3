#include "core/search/ars.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/base/random.h"

namespace orbitune {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

// A smooth cost with its minimum at K = (0.5, 0.5, 0.5, 0.5, 0.5) in the logarithm.
double SmoothCost(const Gains& k) {
  double cost = 10;
  for (std::size_t i = 0; i < k.size(); ++i) cost += static_cast<double>(i + 1) * std::pow(std::log(k[i] / 0.5), 2);
  return cost;
}

EpisodeResult Settled(double cost) {
  return {.outcome = Outcome::kSettled, .settling_samples = 1, .fuel_sum = 2, .cost = cost};
}

void EvaluateSmoothCost(std::span<const Gains> gains, std::span<EpisodeResult> results) {
  for (std::size_t j = 0; j < gains.size(); ++j) results[j] = Settled(SmoothCost(gains[j]));
}

SearchOptions Options() {
  return {.iterations = 30,
          .step_size = 5e-2,
          .exploration_scale = 2e-2,
          .directions = 7,
          .exploration_std = {0.3, 1, 2, 0.5, 3},
          .seed = 77};
}

// The paper's Algorithm 1, written down a second time: one iteration from K, over all pairs.
Gains OneIteration(const SearchOptions& o, int iteration, const Gains& k, double (*cost)(const Gains&)) {
  const auto n = static_cast<std::size_t>(o.directions);
  std::vector<Gains> delta(n);
  std::vector<double> plus(n), minus(n);
  for (std::size_t j = 0; j < n; ++j) {
    Gains up = k, down = k;
    for (std::size_t i = 0; i < 5; ++i) {
      const RandomKey key{.seed = o.seed,
                          .stream = RandomStream::kSearchDirections,
                          .a = static_cast<std::uint32_t>(iteration),
                          .b = static_cast<std::uint32_t>(j)};
      delta[j][i] = o.exploration_std[i] * StandardNormal(key, static_cast<std::uint32_t>(i));
      up[i] = std::max(o.gain_floor, k[i] + o.exploration_scale * delta[j][i]);
      down[i] = std::max(o.gain_floor, k[i] - o.exploration_scale * delta[j][i]);
    }
    plus[j] = cost(up);
    minus[j] = cost(down);
  }
  double mean = 0, variance = 0;
  for (std::size_t j = 0; j < n; ++j) mean += (plus[j] + minus[j]) / (2.0 * o.directions);
  for (std::size_t j = 0; j < n; ++j) {
    variance += (std::pow(plus[j] - mean, 2) + std::pow(minus[j] - mean, 2)) / (2.0 * o.directions);
  }
  Gains next = k;
  for (std::size_t i = 0; i < 5; ++i) {
    double gradient = 0;
    for (std::size_t j = 0; j < n; ++j) gradient += (plus[j] - minus[j]) * delta[j][i];
    next[i] = std::max(o.gain_floor, k[i] - o.step_size / (o.directions * std::sqrt(variance)) * gradient);
  }
  return next;
}

TEST(ArsTest, IsThePapersAlgorithm) {
  const SearchOptions options = Options();
  ArsSearch search(options);
  std::vector<EpisodeResult> results(search.batch().size());
  Gains expected = options.initial_gains;
  for (int i = 1; i <= options.iterations; ++i) {
    EvaluateSmoothCost(search.batch(), results);
    const auto record = search.Update(results);
    ASSERT_TRUE(record.ok());
    EXPECT_EQ(record->iteration, i);
    EXPECT_EQ(record->cost, SmoothCost(record->gains));
    for (std::size_t k = 0; k < 5; ++k) ASSERT_NEAR(record->gains[k] / expected[k], 1, 1e-10) << "iteration " << i;
    expected = OneIteration(options, i, record->gains, &SmoothCost);
  }
}

TEST(ArsTest, FindsTheMinimumOfASmoothCost) {
  SearchOptions options = Options();
  options.iterations = 2000;
  int seen = 0;
  double first = 0, best = std::numeric_limits<double>::infinity();
  const auto observe = [&](const IterationRecord& record) {
    EXPECT_EQ(record.iteration, ++seen);
    if (seen == 1) {
      EXPECT_EQ(record.gains, options.initial_gains);
      first = record.cost;
    }
    best = std::min(best, record.cost);
  };
  ASSERT_TRUE(RunSearch(options, &EvaluateSmoothCost, observe).ok());
  EXPECT_EQ(seen, 2000);
  EXPECT_GT(first, 50);
  // Not the last: the step never anneals.
  EXPECT_LT(best, 10.5);
}

TEST(ArsTest, BatchIsTheGainsThenThePairs) {
  const SearchOptions options = Options();
  const ArsSearch search(options);
  ASSERT_EQ(search.batch().size(), 15u);
  EXPECT_EQ(search.batch()[0], options.initial_gains);
  for (int j = 0; j < options.directions; ++j) {
    const Gains delta = SearchDirection(options, 1, j);
    for (std::size_t i = 0; i < 5; ++i) {
      const double k = options.initial_gains[i], step = options.exploration_scale * delta[i];
      EXPECT_DOUBLE_EQ(search.batch()[static_cast<std::size_t>(1 + 2 * j)][i], k + step);
      EXPECT_DOUBLE_EQ(search.batch()[static_cast<std::size_t>(2 + 2 * j)][i], k - step);
    }
  }
}

TEST(ArsTest, DirectionsAreAFunctionOfSeedIterationAndNumber) {
  const SearchOptions options = Options();
  EXPECT_EQ(SearchDirection(options, 3, 4), SearchDirection(options, 3, 4));
  EXPECT_NE(SearchDirection(options, 3, 4), SearchDirection(options, 4, 3));
  SearchOptions other = options;
  other.seed += 1;
  EXPECT_NE(SearchDirection(options, 3, 4), SearchDirection(other, 3, 4));
  // Not of the number of directions, nor of where the search is.
  other = options;
  other.directions = 1;
  other.initial_gains = {9, 9, 9, 9, 9};
  EXPECT_EQ(SearchDirection(options, 3, 4), SearchDirection(other, 3, 4));
}

TEST(ArsTest, EveryGainSimulatedIsAtLeastTheFloor) {
  SearchOptions options = Options();
  options.gain_floor = 0.05;
  options.initial_gains = {0.05, 0.06, 0.1, 0.2, 0.5};
  options.iterations = 200;
  double lowest = std::numeric_limits<double>::infinity();
  // A cost that pulls every gain to zero.
  const auto evaluate = [&](std::span<const Gains> gains, std::span<EpisodeResult> results) {
    for (std::size_t j = 0; j < gains.size(); ++j) {
      double cost = 1;
      for (const double k : gains[j]) {
        lowest = std::min(lowest, k);
        cost += k;
      }
      results[j] = Settled(cost);
    }
  };
  Gains last{};
  ASSERT_TRUE(RunSearch(options, evaluate, [&](const IterationRecord& record) { last = record.gains; }).ok());
  EXPECT_EQ(lowest, 0.05);
  for (const double k : last) EXPECT_LT(k, 0.3);
}

TEST(ArsTest, PairsWithoutACostAreLeftOutOfTheUpdate) {
  SearchOptions options = Options();
  options.directions = 4;
  ArsSearch search(options);
  std::vector<EpisodeResult> results(search.batch().size());
  EvaluateSmoothCost(search.batch(), results);
  // Pair 0 left the domain on one side, pair 2 failed on the other; pair 1 did not settle, which is a cost.
  results[1] = {.outcome = Outcome::kLeftDomain, .cost = 1e9};
  results[6] = {.outcome = Outcome::kNumericalFailure};
  results[3].outcome = Outcome::kNotSettled;
  const std::vector<Gains> batch(search.batch().begin(), search.batch().end());
  const auto record = search.Update(results);
  ASSERT_TRUE(record.ok());
  EXPECT_EQ(record->pairs_left_out, 2);
  EXPECT_EQ(record->pairs_not_settled, 1);

  const double costs[] = {results[3].cost, results[4].cost, results[7].cost, results[8].cost};
  double mean = 0, variance = 0;
  for (const double c : costs) mean += c / 4;
  for (const double c : costs) variance += (c - mean) * (c - mean) / 4;
  EXPECT_NEAR(record->cost_std / std::sqrt(variance), 1, 1e-12);
  const Gains first = SearchDirection(options, 1, 1), second = SearchDirection(options, 1, 3);
  for (std::size_t i = 0; i < 5; ++i) {
    const double gradient = (costs[0] - costs[1]) * first[i] + (costs[2] - costs[3]) * second[i];
    const double expected = options.initial_gains[i] - options.step_size / (2 * std::sqrt(variance)) * gradient;
    EXPECT_NEAR(search.batch()[0][i] / expected, 1, 1e-12);
  }
}

TEST(ArsTest, AllPairsLeftOutIsAnErrorAndMovesNothing) {
  const SearchOptions options = Options();
  ArsSearch search(options);
  const std::vector<Gains> batch(search.batch().begin(), search.batch().end());
  std::vector<EpisodeResult> results(batch.size(), EpisodeResult{.outcome = Outcome::kLeftDomain});
  results[0] = Settled(3);
  const auto record = search.Update(results);
  EXPECT_EQ(record.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(record.status().message()), AllOf(HasSubstr("iteration 1"), HasSubstr("all 7 pairs")));
  EXPECT_EQ(search.iteration(), 1);
  EXPECT_TRUE(std::ranges::equal(search.batch(), batch));

  // A search driven by RunSearch stops there, with that error.
  int seen = 0;
  const auto evaluate = [&](std::span<const Gains>, std::span<EpisodeResult> out) {
    for (auto& r : out) r = {.outcome = Outcome::kNumericalFailure};
  };
  EXPECT_EQ(RunSearch(options, evaluate, [&](const IterationRecord&) { ++seen; }), record.status());
  EXPECT_EQ(seen, 0);
}

// K(i) itself may leave the domain while its pairs do not.
TEST(ArsTest, OwnEpisodeWithoutACostIsRecordedAsSuch) {
  ArsSearch search(Options());
  std::vector<EpisodeResult> results(search.batch().size());
  EvaluateSmoothCost(search.batch(), results);
  results[0] = {.outcome = Outcome::kLeftDomain};
  const auto record = search.Update(results);
  ASSERT_TRUE(record.ok());
  EXPECT_EQ(record->outcome, Outcome::kLeftDomain);
  EXPECT_TRUE(std::isnan(record->cost));
  EXPECT_EQ(record->pairs_left_out, 0);
}

TEST(ArsTest, EqualCostsTakeNoStep) {
  ArsSearch search(Options());
  std::vector<EpisodeResult> results(search.batch().size(), Settled(42));
  for (int i = 1; i <= 3; ++i) {
    const auto record = search.Update(results);
    ASSERT_TRUE(record.ok());
    EXPECT_EQ(record->cost_std, 0);
    EXPECT_EQ(record->iteration, i);
    EXPECT_EQ(search.batch()[0], Options().initial_gains);
  }
}

TEST(ArsTest, ResumesFromAnyRecordToTheSameBits) {
  const SearchOptions options = Options();
  std::vector<IterationRecord> whole;
  const auto keep = [&](const IterationRecord& record) { whole.push_back(record); };
  ASSERT_TRUE(RunSearch(options, &EvaluateSmoothCost, keep).ok());
  for (std::size_t start = 0; start < whole.size(); ++start) {
    ArsSearch search(options);
    ASSERT_TRUE(search.Resume(whole[start], {}).ok());
    std::vector<EpisodeResult> results(search.batch().size());
    for (std::size_t i = start; i < whole.size(); ++i) {
      ASSERT_FALSE(search.done());
      EvaluateSmoothCost(search.batch(), results);
      const auto record = search.Update(results);
      ASSERT_TRUE(record.ok());
      ASSERT_TRUE(Identical(*record, whole[i])) << "resumed at " << start + 1 << ", iteration " << i + 1;
    }
    EXPECT_TRUE(search.done());
  }
}

struct BadOption {
  const char* name;
  void (*change)(SearchOptions&);
  const char* field;
  const char* description;
};

void PrintTo(const BadOption& bad, std::ostream* os) { *os << bad.field; }

class ArsValidateFieldTest : public ::testing::TestWithParam<BadOption> {};

TEST_P(ArsValidateFieldTest, NamesFieldRangeAndValue) {
  SearchOptions options;
  ASSERT_TRUE(options.Validate().ok());
  GetParam().change(options);
  const absl::Status status = options.Validate();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  const auto violations = FieldViolationsOf(status);
  ASSERT_EQ(violations.size(), 1u) << status;
  EXPECT_EQ(violations[0].field, GetParam().field);
  EXPECT_EQ(violations[0].description, GetParam().description);
  EXPECT_EQ(RunSearch(options, nullptr, nullptr), status);
}

INSTANTIATE_TEST_SUITE_P(
    , ArsValidateFieldTest,
    ::testing::Values(BadOption{"NoIterations", [](SearchOptions& o) { o.iterations = 0; }, "iterations",
                                "must be in [1, 10000000], got 0"},
                      BadOption{"TooManyIterations", [](SearchOptions& o) { o.iterations = 10'000'001; }, "iterations",
                                "must be in [1, 10000000], got 10000001"},
                      BadOption{"NoDirections", [](SearchOptions& o) { o.directions = 0; }, "directions",
                                "must be in [1, 1024], got 0"},
                      BadOption{"TooManyDirections", [](SearchOptions& o) { o.directions = 1025; }, "directions",
                                "must be in [1, 1024], got 1025"},
                      BadOption{"StepSize", [](SearchOptions& o) { o.step_size = -1; }, "step_size",
                                "must be > 0 and finite, got -1"},
                      BadOption{"ExplorationScale", [](SearchOptions& o) { o.exploration_scale = std::nan(""); },
                                "exploration_scale", "must be > 0 and finite, got nan"},
                      BadOption{"GainFloor", [](SearchOptions& o) { o.gain_floor = 0; }, "gain_floor",
                                "must be > 0 and finite, got 0"},
                      BadOption{"GainBelowFloor", [](SearchOptions& o) { o.initial_gains[1] = 1e-4; },
                                "initial_gains.k2", "must be in [gain_floor, 1e+06] = [0.001, 1e+06], got 1e-04"},
                      BadOption{"GainTooLarge", [](SearchOptions& o) { o.initial_gains[4] = 2e6; }, "initial_gains.k5",
                                "must be in [gain_floor, 1e+06] = [0.001, 1e+06], got 2e+06"},
                      BadOption{"NegativeStd", [](SearchOptions& o) { o.exploration_std[0] = -0.5; },
                                "exploration_std.k1", "must be in [0, 1e+06], got -0.5"},
                      BadOption{"NoStd", [](SearchOptions& o) { o.exploration_std = {}; }, "exploration_std",
                                "must be > 0 for at least one gain, got 0 for all"}),
    [](const auto& test) { return std::string(test.param.name); });

TEST(ArsValidateTest, NamesEveryBadFieldAtOnce) {
  SearchOptions options;
  options.iterations = -5;
  options.step_size = std::numeric_limits<double>::infinity();
  options.initial_gains[2] = std::nan("");
  options.exploration_std[3] = std::nan("");
  const auto violations = FieldViolationsOf(options.Validate());
  ASSERT_EQ(violations.size(), 4u);
  EXPECT_EQ(violations[0].field, "iterations");
  EXPECT_EQ(violations[1].field, "step_size");
  EXPECT_EQ(violations[2].field, "initial_gains.k3");
  EXPECT_EQ(violations[3].field, "exploration_std.k4");
}

}  // namespace
}  // namespace orbitune
