#include "core/library/query.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <map>
#include <set>

#include "absl/strings/str_cat.h"
#include "core/scenario/presets.h"
#include "core/simd/batch_simulator.h"
#include "tests/core/testing.h"

namespace orbitune {
namespace {

using testing::Random;
using Source = Candidate::Source;

constexpr Gains kInitialGains{0.1, 1, 1, 1, 10};

void Flying(const EpisodeProblem& problem, std::span<const Gains> gains, std::span<EpisodeResult> results) {
  std::vector<BatchEpisode> episodes;
  for (const Gains& k : gains) episodes.push_back({.problem = &problem, .gains = k});
  SimulateBatch(episodes, results);
}

class QueryTest : public ::testing::Test {
 protected:
  QueryTest() : prepared_(*Prepare(*FindPreset("leo-rendezvous"))), library_(prepared_.problem.settling_distance) {}

  void Store(const std::string& id, const Gains& gains, std::optional<ErrorState> start,
             GainSetKind kind = GainSetKind::kTuned) {
    const LibraryEntry entry{.id = id, .kind = kind, .gains = gains, .initial_error = start};
    library_.Add({&entry, 1});
  }

  void StoreMany(int count) {
    Random random(1);
    for (int i = 0; i < count; ++i) {
      ErrorState start = prepared_.problem.initial_error;
      start.x1 += 1e-3 * random.Normal();
      start.x5 += 1e-3 * random.Normal();
      Gains gains;
      for (double& gain : gains) gain = random.LogUniform(0.3, 3);
      Store(absl::StrCat(i), gains, start);
    }
  }

  std::vector<Candidate> Choose(int most) const {
    LibraryPosition position;
    return ChooseCandidates(&library_, prepared_.problem.initial_error, kInitialGains, {.max_candidates = most},
                            position);
  }

  PreparedScenario prepared_;
  ScenarioLibrary library_;
};

std::set<Source> SourcesOf(const std::vector<Candidate>& candidates) {
  std::set<Source> sources;
  for (const Candidate& candidate : candidates) sources.insert(candidate.source);
  return sources;
}

TEST_F(QueryTest, WithoutALibraryTheScenariosOwnGainsAreFlown) {
  for (const ScenarioLibrary* library : std::array<const ScenarioLibrary*, 2>{nullptr, &library_}) {
    const QueryResult query = QueryLibrary(library, prepared_, kInitialGains, {}, Flying);
    EXPECT_EQ(query.position.library_size, 0u);
    ASSERT_EQ(query.answers.size(), 1u);
    EXPECT_EQ(query.answers[0].candidate.source, Source::kInitial);
    EXPECT_NEAR(query.answers[0].flight.cost, 313.298, 1e-3);
    EXPECT_TRUE(query.settled());
  }
}

TEST_F(QueryTest, EveryStoredOneIsACandidateWhereThereAreFew) {
  StoreMany(40);
  Store("mean", {1, 1, 1, 1, 1}, {}, GainSetKind::kMean);
  Store("robust", {2, 2, 2, 2, 2}, {}, GainSetKind::kRobust);
  const auto candidates = Choose(64);
  std::set<std::string> stored;
  for (const Candidate& c : candidates) {
    if (c.source == Source::kStored) stored.insert(c.gain_set_id);
  }
  EXPECT_EQ(stored.size(), 42u);
  EXPECT_EQ(SourcesOf(candidates),
            (std::set{Source::kStored, Source::kWeightedMean, Source::kLibraryMean, Source::kInitial}));
}

TEST_F(QueryTest, MaxCandidatesHoldsAndNoGainsAreFlownTwice) {
  StoreMany(200);
  Store("again", kInitialGains, prepared_.problem.initial_error);  // the nearest, with K(1)
  for (const int most : {1, 2, 7, 64}) {
    const auto candidates = Choose(most);
    EXPECT_EQ(candidates.size(), static_cast<std::size_t>(most));
    EXPECT_EQ(candidates[0].gain_set_id, "again");
    std::set<Gains> gains;
    for (const Candidate& candidate : candidates) EXPECT_TRUE(gains.insert(candidate.gains).second);
  }
}

TEST_F(QueryTest, ManyGeneralSetsLeaveRoomForTheNearest) {
  StoreMany(50);
  for (int i = 0; i < 50; ++i) Store(absl::StrCat("mean", i), {1.0 + i, 1, 1, 1, 1}, {}, GainSetKind::kMean);
  const auto candidates = Choose(40);
  const auto general = std::ranges::count(candidates, GainSetKind::kMean, &Candidate::kind);
  EXPECT_EQ(general, 10);
}

TEST_F(QueryTest, AnswersAreRankedByWhatTheyCostFromHere) {
  StoreMany(60);
  const QueryResult query = QueryLibrary(&library_, prepared_, kInitialGains, {.max_answers = 64}, Flying);
  ASSERT_EQ(query.answers.size(), 64u);
  EXPECT_EQ(query.candidates, 64);
  for (std::size_t i = 0; i < query.answers.size(); ++i) {
    const QueryAnswer& answer = query.answers[i];
    EpisodeResult alone;
    Flying(prepared_.problem, {&answer.candidate.gains, 1}, {&alone, 1});
    EXPECT_EQ(answer.flight.cost, alone.cost) << "flown from another start?";
    EXPECT_GT(answer.flight.delta_v_m_s, 0);
    EXPECT_TRUE(answer.flight.certificate.lyapunov_decreasing);
    if (i == 0) continue;
    const Flight& before = query.answers[i - 1].flight;
    const auto unsettled = [](const Flight& f) { return f.outcome != Outcome::kSettled; };
    EXPECT_TRUE(unsettled(before) < unsettled(answer.flight) ||
                (unsettled(before) == unsettled(answer.flight) && before.cost <= answer.flight.cost))
        << i;
  }
  EXPECT_EQ(QueryLibrary(&library_, prepared_, kInitialGains, {.max_answers = 2}, Flying).answers.size(), 2u);
}

// Whatever its cost, gains that did not settle come after every one that did; those without a cost come last.
TEST_F(QueryTest, NothingUnsettledIsRankedFirst) {
  StoreMany(3);
  const std::vector<EpisodeResult> script = {
      {.outcome = Outcome::kLeftDomain},
      {.outcome = Outcome::kNotSettled, .settling_samples = 1280, .fuel_sum = 0, .cost = 10},
      {.outcome = Outcome::kSettled, .settling_samples = 9, .fuel_sum = 1, .cost = 500},
      {.outcome = Outcome::kNumericalFailure},
      {.outcome = Outcome::kNotSettled, .settling_samples = 1280, .fuel_sum = 0, .cost = 5},
      {.outcome = Outcome::kSettled, .settling_samples = 8, .fuel_sum = 1, .cost = 400}};
  std::map<Gains, EpisodeResult> by_gains;
  const Fly scripted = [&](const EpisodeProblem&, std::span<const Gains> gains, std::span<EpisodeResult> results) {
    for (std::size_t i = 0; i < gains.size(); ++i) {
      if (by_gains.size() < script.size()) by_gains.emplace(gains[i], script[by_gains.size()]);
      results[i] = by_gains.at(gains[i]);
    }
  };
  const QueryResult query = QueryLibrary(&library_, prepared_, kInitialGains, {.max_answers = 9}, scripted);
  std::vector<double> costs;
  for (const QueryAnswer& answer : query.answers) {
    if (HasCost(answer.flight.outcome)) costs.push_back(answer.flight.cost);
  }
  EXPECT_EQ(query.candidates_settled, 2);
  EXPECT_TRUE(query.settled());
  ASSERT_GE(costs.size(), 4u);
  EXPECT_EQ(std::vector(costs.begin(), costs.begin() + 4), (std::vector<double>{400, 500, 5, 10}));
}

// Screening saves time; it must not show in the answers.
TEST_F(QueryTest, AnswersAreFlownAtTheScenariosOwnTolerance) {
  StoreMany(60);
  std::vector<std::pair<double, std::size_t>> flown;  // tolerance, episodes
  const Fly noting = [&](const EpisodeProblem& problem, std::span<const Gains> gains, std::span<EpisodeResult> out) {
    flown.emplace_back(problem.tolerance, gains.size());
    Flying(problem, gains, out);
  };
  const QueryResult query = QueryLibrary(&library_, prepared_, kInitialGains, {.max_answers = 3}, noting);
  ASSERT_EQ(flown.size(), 2u);
  EXPECT_EQ(flown[0].second, 64u);
  EXPECT_EQ(flown[1].first, prepared_.problem.tolerance);
  EXPECT_LT(flown[1].second, 10u);
  // The same three as without screening.
  const QueryResult all = QueryLibrary(&library_, prepared_, kInitialGains, {.max_answers = 64}, Flying);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(query.answers[i].candidate.gains, all.answers[i].candidate.gains) << i;
    EXPECT_EQ(query.answers[i].flight.cost, all.answers[i].flight.cost) << i;
  }
}

TEST_F(QueryTest, ARefinementIsFirstWhereItIsBetterAndNoOneSeesItWhereItIsNot) {
  StoreMany(5);
  QueryResult query = QueryLibrary(&library_, prepared_, kInitialGains, {.max_answers = 4}, Flying);
  const double before = query.answers.front().flight.cost;
  RefineAnswers(prepared_, {.budget = std::chrono::milliseconds(200)}, Flying, 4, query);
  ASSERT_TRUE(query.refined);
  EXPECT_GT(query.refined->episodes, 32);
  ASSERT_TRUE(query.refined->improved);
  EXPECT_EQ(query.answers.size(), 4u);
  EXPECT_EQ(query.answers.front().candidate.source, Source::kRefined);
  EXPECT_LT(query.answers.front().flight.cost, before);
  EXPECT_TRUE(query.answers.front().flight.certificate.lyapunov_decreasing);

  QueryResult none = QueryLibrary(&library_, prepared_, kInitialGains, {.max_answers = 4}, Flying);
  RefineAnswers(prepared_, {.budget = std::chrono::milliseconds(0)}, Flying, 4, none);
  EXPECT_FALSE(none.refined->improved);
  EXPECT_EQ(none.answers.front().flight.cost, before);
}

TEST_F(QueryTest, ARefinementEndsWhenNobodyWaits) {
  QueryResult query = QueryLibrary(nullptr, prepared_, kInitialGains, {}, Flying);
  RefineAnswers(prepared_, {.budget = std::chrono::hours(1), .cancelled = [] { return true; }}, Flying, 4, query);
  EXPECT_EQ(query.refined->episodes, 0);
  EXPECT_FALSE(query.refined->improved);
}

TEST_F(QueryTest, SaysSoWhereNothingSettles) {
  Scenario printed = *FindPreset("gto-geo-printed");
  const PreparedScenario prepared = *Prepare(printed);
  const QueryResult query = QueryLibrary(nullptr, prepared, kInitialGains, {}, Flying);
  EXPECT_FALSE(query.settled());
  ASSERT_EQ(query.answers.size(), 1u);
  EXPECT_EQ(query.answers[0].flight.outcome, Outcome::kLeftDomain);
  EXPECT_FALSE(query.answers[0].flight.certificate.settled);
}

}  // namespace
}  // namespace orbitune
