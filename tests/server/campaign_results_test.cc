// What a campaign's numbers are made of, against values worked out by hand, and the comparison of gains over episodes.
#include "server/jobs/campaign_results.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/sim/scalar_simulator.h"
#include "tests/server/engine_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::HasSubstr;

TEST(CampaignStatistics, AgreeWithValuesWorkedOutByHand) {
  // In order 10 20 40 50 80: ranks 0.2, 1, 2, 3 and 3.8.
  const ReductionStatistics s = StatisticsOf({50, 10, 80, 20, 40});
  EXPECT_DOUBLE_EQ(s.average, 40);
  EXPECT_EQ(s.minimum, 10);
  EXPECT_EQ(s.maximum, 80);
  EXPECT_DOUBLE_EQ(s.percentiles[0], 12);
  EXPECT_DOUBLE_EQ(s.percentiles[1], 20);
  EXPECT_DOUBLE_EQ(s.percentiles[2], 40);
  EXPECT_DOUBLE_EQ(s.percentiles[3], 50);
  EXPECT_DOUBLE_EQ(s.percentiles[4], 74);
}

TEST(CampaignStatistics, OfOneNumberAreThatAndOfNoneNothing) {
  const ReductionStatistics one = StatisticsOf({-7.5});
  EXPECT_EQ(one.average, -7.5);
  for (const double p : one.percentiles) EXPECT_EQ(p, -7.5);
  const ReductionStatistics none = StatisticsOf({});
  EXPECT_TRUE(std::isnan(none.average) && std::isnan(none.minimum) && std::isnan(none.percentiles[2]));
}

TEST(CampaignStatistics, TheMeanOfGainsIsArithmetic) {
  const std::vector<Gains> gains = {{1, 2, 3, 4, 5}, {3, 2, 6, 0.5, 10}, {2, 2, 0, 0, 0}};
  EXPECT_EQ(MeanGains(gains), (Gains{2, 2, 3, 1.5, 5}));
}

TEST(CampaignStatistics, TunedGainsAreTheLastOfArsAndTheBestOfOthers) {
  JobReport report;
  report.final.iteration = 40;
  report.best.iteration = 33;
  EXPECT_EQ(TunedGains(report, Algorithm::kArs).iteration, 40);
  EXPECT_EQ(TunedGains(report, Algorithm::kCmaEs).iteration, 33);
}

// A member whose job found `gains`, as the engine would have it.
EndedMember TunedMember(const Scenario& scenario, int number, const OrbitState& state, const Gains& gains) {
  EndedMember member;
  member.member = {
      .id = {MemberRole::kTuned, number}, .initial_condition = state, .job_id = absl::StrCat("job", number)};
  const auto prepared = Prepare(scenario, state);
  EXPECT_TRUE(prepared.ok());
  const auto assess = [&](const Gains& k) {
    const EpisodeResult result = SimulateAlone(*prepared, k);
    GainsAssessment assessed{.iteration = 1, .gains = k};
    assessed.episode.outcome = result.outcome;
    assessed.episode.cost = result.cost;
    assessed.episode.settling_samples = result.settling_samples;
    assessed.episode.fuel_sum = result.fuel_sum;
    assessed.episode.delta_v_to_settling_m_s = 10.0 * number;
    return assessed;
  };
  member.report = JobReport{
      .initial = assess(scenario.search.initial_gains), .final = assess(gains), .best = assess(gains), .episodes = 7};
  return member;
}

OrbitState Start(const Scenario& scenario, double p_offset_km) {
  auto state = std::get<EquinoctialState>(scenario.chaser);
  state.p_km += p_offset_km;
  return state;
}

class CompareGainsTest : public testing::Test {
 protected:
  CompareGainsTest() {
    spec_.scenario = SmallScenario();
    spec_.scenario.horizon_samples = 300;
    members_.push_back(TunedMember(spec_.scenario, 1, Start(spec_.scenario, 0), {0.6, 0.5, 0.8, 0.8, 9}));
    members_.push_back(TunedMember(spec_.scenario, 2, Start(spec_.scenario, 10), {0.8, 0.3, 0.6, 1.2, 7}));
  }

  EndedMember HeldOut(int number, double p_offset_km) const {
    return {.member = {.id = {MemberRole::kHeldOut, number}, .initial_condition = Start(spec_.scenario, p_offset_km)}};
  }

  CampaignOutcome Compare() {
    auto outcome = CompareGains(spec_, members_, [] { return false; });
    EXPECT_TRUE(outcome.ok()) << outcome.status();
    return outcome.ok() ? *std::move(outcome) : CampaignOutcome{};
  }

  static const GainsComparison* Find(const CampaignResults& results, GainsChoice choice, MemberRole over) {
    for (const GainsComparison& c : results.comparisons) {
      if (c.choice == choice && c.over == over) return &c;
    }
    return nullptr;
  }

  CampaignSpec spec_;
  std::vector<EndedMember> members_;
};

TEST_F(CompareGainsTest, TheMeanIsFlownOnEveryInitialCondition) {
  const CampaignOutcome outcome = Compare();
  EXPECT_EQ(outcome.results.mean_of, 2);
  const Gains mean = outcome.results.mean_gains;
  EXPECT_DOUBLE_EQ(mean[0], 0.7);
  EXPECT_DOUBLE_EQ(mean[4], 8);
  EXPECT_EQ(outcome.results.episodes, 14);
  ASSERT_EQ(outcome.members.size(), 2u);
  std::vector<double> reductions;
  for (const CampaignMember& member : outcome.members) {
    ASSERT_EQ(member.episodes.size(), 4u);
    const auto prepared = Prepare(spec_.scenario, member.initial_condition);
    const EpisodeResult flown = SimulateEpisode(prepared->problem, mean);
    EXPECT_EQ(member.episodes[3].choice, GainsChoice::kMean);
    EXPECT_EQ(member.episodes[3].cost, flown.cost);
    EXPECT_GT(member.episodes[3].delta_v_to_settling_m_s, 0);
    reductions.push_back(100 * (1 - flown.cost / member.episodes[0].cost));
  }
  const GainsComparison* const compared = Find(outcome.results, GainsChoice::kMean, MemberRole::kTuned);
  ASSERT_NE(compared, nullptr);
  EXPECT_EQ(compared->compared, 2);
  EXPECT_DOUBLE_EQ(compared->cost_percent.average, (reductions[0] + reductions[1]) / 2);
  EXPECT_EQ(Find(outcome.results, GainsChoice::kRobust, MemberRole::kTuned), nullptr);
  EXPECT_FALSE(outcome.results.best_on_held_out);
  EXPECT_THAT(outcome.results.conclusion, HasSubstr("is not known"));
}

TEST_F(CompareGainsTest, HeldOutOnesFlyTheNearestAndTheRobustGainsToo) {
  members_.push_back(HeldOut(1, 9));
  members_.push_back(HeldOut(2, 1));
  EndedMember robust;
  robust.member = {.id = {MemberRole::kRobust, 1}, .job_id = "robust"};
  robust.report = JobReport{};
  robust.report->best.gains = {0.5, 0.5, 0.5, 0.5, 5};
  members_.push_back(robust);
  const CampaignOutcome outcome = Compare();
  ASSERT_TRUE(outcome.results.robust_gains);
  EXPECT_EQ((*outcome.results.robust_gains)[4], 5);
  ASSERT_EQ(outcome.members.size(), 4u);
  const auto& nearest_to_second = outcome.members[2].episodes.back();
  EXPECT_EQ(nearest_to_second.choice, GainsChoice::kNearest);
  EXPECT_EQ(nearest_to_second.gains, members_[1].report->final.gains);
  EXPECT_EQ(outcome.members[3].episodes.back().gains, members_[0].report->final.gains);
  const GainsComparison* const held_out = Find(outcome.results, GainsChoice::kRobust, MemberRole::kHeldOut);
  ASSERT_NE(held_out, nullptr);
  EXPECT_EQ(held_out->flown, 2);
  ASSERT_TRUE(outcome.results.best_on_held_out);
  EXPECT_THAT(outcome.results.conclusion, HasSubstr("On the 2 held-out initial conditions"));
}

TEST_F(CompareGainsTest, JobsThatFailedAreNamedAndInNoAverage) {
  EndedMember failed;
  failed.member = {.id = {MemberRole::kTuned, 3}, .initial_condition = Start(spec_.scenario, 5), .job_id = "abc"};
  failed.state = JobState::kFailed;
  failed.error_message = "every pair left the domain";
  members_.push_back(failed);
  const CampaignOutcome outcome = Compare();
  EXPECT_EQ(outcome.results.mean_of, 2);
  EXPECT_THAT(outcome.results.conclusion, HasSubstr("initial condition 3 (jobs/abc): every pair left the domain"));
  // Its initial condition is still one to fly common gains on.
  EXPECT_EQ(Find(outcome.results, GainsChoice::kMean, MemberRole::kTuned)->flown, 3);
  EXPECT_EQ(Find(outcome.results, GainsChoice::kTuned, MemberRole::kTuned)->flown, 2);
}

TEST_F(CompareGainsTest, WithoutATunedMemberThereIsNothingToCompare) {
  for (EndedMember& member : members_) {
    member.report.reset();
    member.state = JobState::kFailed;
    member.error_message = "left the domain";
  }
  const auto outcome = CompareGains(spec_, members_, [] { return false; });
  EXPECT_EQ(outcome.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(outcome.status().message()), HasSubstr("2 jobs did not succeed"));
}

TEST_F(CompareGainsTest, StopsWhereNobodyWantsItAnyMore) {
  const auto outcome = CompareGains(spec_, members_, [] { return true; });
  EXPECT_EQ(outcome.status().code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace orbitune::server_test
