// Campaigns run with no gRPC around them: together begun, halted, ended, extended and taken up again, bit for bit.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <set>
#include <thread>

#include "absl/strings/str_cat.h"
#include "core/scenario/presets.h"
#include "tests/server/engine_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

IcDistribution SmallNeighbourhood() {
  const auto chaser = std::get<EquinoctialState>(SmallScenario().chaser);
  return EquinoctialDistribution{.p_km = NormalVariate{chaser.p_km, 5},
                                 .ex = FixedValue{chaser.ex},
                                 .ey = FixedValue{chaser.ey},
                                 .hx = FixedValue{chaser.hx},
                                 .hy = FixedValue{chaser.hy},
                                 .true_longitude_deg = UniformVariate{45, 45.5}};
}

// So many initial conditions of SmallScenario, drawn.
CampaignRequest SmallCampaign(int count, int iterations = 12, int held_out = 0) {
  CampaignRequest request;
  request.job = JobOf(SmallScenario(iterations));
  request.initial_conditions.draw = {.distribution = SmallNeighbourhood(), .seed = 7, .count = count};
  if (held_out > 0) request.held_out.draw = {.count = held_out};
  return request;
}

class CampaignTest : public testing::Test {
 protected:
  void Open() {
    engine_.reset();
    engine_ = std::make_unique<Engine>(directory_.File("orbitune.db"));
  }
  void SetUp() override { Open(); }

  CampaignUseCases& campaigns() { return engine_->campaigns(); }

  std::string Create(const CampaignRequest& request, const std::string& request_id = "") {
    const auto record = campaigns().Create(request, request_id, false);
    EXPECT_TRUE(record.ok()) << record.status();
    return record.ok() ? record->id : "";
  }

  CampaignRecord WaitFor(const std::string& id, const std::function<bool(const CampaignRecord&)>& condition) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(3);
    while (true) {
      auto record = campaigns().Get(id);
      EXPECT_TRUE(record.ok()) << record.status();
      if (!record.ok() || condition(*record)) return record.ok() ? *record : CampaignRecord{};
      if (std::chrono::steady_clock::now() > deadline) {
        ADD_FAILURE() << "campaign " << id << " hangs at event " << record->last_seq;
        return *record;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }
  CampaignRecord WaitForEnd(const std::string& id) {
    return WaitFor(id, [](const CampaignRecord& r) { return IsTerminal(r.state); });
  }

  std::vector<MemberView> Members(const std::string& id) {
    auto page = campaigns().ListMembers(id, 1000, "");
    EXPECT_TRUE(page.ok()) << page.status();
    return page.ok() ? page->items : std::vector<MemberView>{};
  }

  // Seqs dense from 1, one end for each job, nothing after the last state.
  void ExpectWholeStory(const std::string& id, std::size_t jobs, CampaignState last) {
    const auto events = campaigns().ListEvents(id, 0, 10'000);
    ASSERT_TRUE(events.ok()) << events.status();
    std::set<MemberId> ended;
    for (std::size_t i = 0; i < events->size(); ++i) {
      ASSERT_EQ((*events)[i].event.seq, static_cast<std::int64_t>(i + 1));
      if (const auto* end = std::get_if<MemberEnded>(&(*events)[i].event.what)) {
        EXPECT_TRUE(ended.insert(end->member).second) << "member " << end->member.number << " ended twice";
      }
    }
    EXPECT_EQ(ended.size(), jobs);
    const auto* change = std::get_if<CampaignStateChange>(&events->back().event.what);
    ASSERT_NE(change, nullptr);
    EXPECT_EQ(change->state, last);
  }

  TemporaryDirectory directory_;
  std::unique_ptr<Engine> engine_;
};

TEST_F(CampaignTest, TunesEveryInitialConditionAndComparesTheGains) {
  CampaignRequest request = SmallCampaign(5, 12, 3);
  request.robust.emplace();
  request.robust->search.algorithm = Algorithm::kCmaEs;
  request.robust->search.max_episodes = 400;
  const std::string id = Create(request);
  const CampaignRecord record = WaitForEnd(id);
  EXPECT_EQ(record.state, CampaignState::kSucceeded) << record.error_message;
  ASSERT_TRUE(record.results);
  EXPECT_EQ(record.results->mean_of, 5);
  EXPECT_TRUE(record.results->robust_gains);
  EXPECT_EQ(record.of(MemberRole::kTuned).succeeded, 5);
  EXPECT_EQ(record.of(MemberRole::kHeldOut).jobs, 0);
  ExpectWholeStory(id, 6, CampaignState::kSucceeded);

  const auto members = Members(id);
  ASSERT_EQ(members.size(), 9u);
  Gains mean{};
  for (std::size_t i = 0; i < 5; ++i) {
    const MemberView& m = members[i];
    ASSERT_TRUE(m.job);
    // An ordinary job: the history that its spec gives, with a seed of its own.
    Scenario scenario = m.job->spec.scenario;
    EXPECT_EQ(scenario.search.seed, SmallScenario().search.seed + i);
    scenario.chaser = m.member.initial_condition;
    const auto history = PlainHistory(scenario);
    ExpectSameHistory(engine_->History(m.job->id), history);
    for (std::size_t k = 0; k < kGainCount; ++k) mean[k] += history.back().gains[k] / 5;
  }
  for (std::size_t k = 0; k < kGainCount; ++k) EXPECT_NEAR(record.results->mean_gains[k], mean[k], 1e-12);
}

TEST_F(CampaignTest, ItsJobsAreInListsOnlyWhereAskedFor) {
  const std::string id = Create(SmallCampaign(3));
  WaitForEnd(id);
  const std::string single = engine_->Create(SmallScenario(2));
  const auto jobs = engine_->use_cases().ListJobs(0, "", "", "");
  ASSERT_TRUE(jobs.ok());
  ASSERT_EQ(jobs->items.size(), 1u);
  EXPECT_EQ(jobs->items[0].id, single);
  const auto members = engine_->use_cases().ListJobs(0, "", absl::StrCat("campaign = \"campaigns/", id, "\""), "");
  ASSERT_TRUE(members.ok()) << members.status();
  EXPECT_EQ(members->items.size(), 3u);
  for (const JobRecord& job : members->items) EXPECT_EQ(job.spec.campaign_id, id);
}

TEST_F(CampaignTest, TheSameRequestIdGivesTheCampaignCreatedBefore) {
  const std::string id = Create(SmallCampaign(2), "mine");
  const auto again = campaigns().Create(SmallCampaign(2), "mine", false);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ(again->id, id);
  const auto other = campaigns().Create(SmallCampaign(3), "mine", false);
  EXPECT_EQ(other.status().code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(ReasonOf(other.status()), "REQUEST_ID_REUSED");
  const auto all = campaigns().List(0, "", {});
  ASSERT_TRUE(all.ok());
  EXPECT_EQ(all->items.size(), 1u);
}

TEST_F(CampaignTest, PausesAndResumesWithTheResultsOfAnUnbrokenRun) {
  const std::string unbroken = Create(SmallCampaign(4, 600, 2));
  const CampaignRecord expected = WaitForEnd(unbroken);
  const std::string id = Create(SmallCampaign(4, 600, 2));
  WaitFor(id, [](const CampaignRecord& r) { return r.of(MemberRole::kTuned).iterations >= 5; });
  auto paused = campaigns().Pause(id, "");
  ASSERT_TRUE(paused.ok()) << paused.status();
  EXPECT_EQ(paused->state, CampaignState::kPaused);
  EXPECT_EQ(paused->of(MemberRole::kTuned).running, 0);
  EXPECT_EQ(campaigns().Pause(id, "").status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(campaigns().Resume(id, "stale").status().code(), absl::StatusCode::kAborted);
  // Nor does a restart let it go on.
  Open();
  EXPECT_EQ(campaigns().Get(id)->state, CampaignState::kPaused);
  EXPECT_EQ(campaigns().Get(id)->of(MemberRole::kTuned).running, 0);
  auto resumed = campaigns().Resume(id, "");
  ASSERT_TRUE(resumed.ok()) << resumed.status();
  const CampaignRecord record = WaitForEnd(id);
  EXPECT_EQ(record.state, CampaignState::kSucceeded);
  EXPECT_EQ(record.results->mean_gains, expected.results->mean_gains);
  EXPECT_EQ(record.results->conclusion, expected.results->conclusion);
  ExpectWholeStory(id, 4, CampaignState::kSucceeded);
}

TEST_F(CampaignTest, ARestartTakesUpWhatIsUnfinished) {
  const std::string unbroken = Create(SmallCampaign(4, 40));
  const CampaignRecord expected = WaitForEnd(unbroken);
  const std::string id = Create(SmallCampaign(4, 40));
  WaitFor(id, [](const CampaignRecord& r) { return r.of(MemberRole::kTuned).iterations >= 10; });
  Open();
  const CampaignRecord record = WaitForEnd(id);
  EXPECT_EQ(record.state, CampaignState::kSucceeded);
  EXPECT_EQ(record.results->mean_gains, expected.results->mean_gains);
  ExpectWholeStory(id, 4, CampaignState::kSucceeded);
  const auto members = Members(id);
  const auto others = Members(unbroken);
  for (std::size_t i = 0; i < members.size(); ++i) {
    ExpectSameHistory(engine_->History(members[i].job->id), engine_->History(others[i].job->id));
  }
}

TEST_F(CampaignTest, CancelEndsEveryJob) {
  CampaignRequest request = SmallCampaign(6);
  request.job = JobOf(EndlessScenario());
  const std::string id = Create(request);
  WaitFor(id, [](const CampaignRecord& r) { return r.of(MemberRole::kTuned).iterations > 0; });
  EXPECT_EQ(campaigns().Delete(id, "").code(), absl::StatusCode::kFailedPrecondition);
  const auto cancelled = campaigns().Cancel(id, "");
  ASSERT_TRUE(cancelled.ok()) << cancelled.status();
  EXPECT_EQ(cancelled->state, CampaignState::kCancelled);
  for (const MemberView& m : Members(id)) EXPECT_EQ(m.job->state, JobState::kCancelled);
  EXPECT_EQ(campaigns().Resume(id, "").status().code(), absl::StatusCode::kFailedPrecondition);
  const std::string job = Members(id)[0].job->id;
  EXPECT_TRUE(campaigns().Delete(id, "").ok());
  EXPECT_EQ(campaigns().Get(id).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(engine_->use_cases().GetJob(job).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(CampaignTest, ItsJobsAreHaltedWithItAndNotAlone) {
  CampaignRequest request = SmallCampaign(2);
  request.job = JobOf(EndlessScenario());
  const std::string id = Create(request);
  const std::string job = Members(id)[0].job->id;
  for (const auto& status :
       {engine_->use_cases().PauseJob(job, "").status(), engine_->use_cases().ResumeJob(job, "").status(),
        engine_->use_cases().DeleteJob(job, "")}) {
    EXPECT_EQ(ReasonOf(status), "CAMPAIGN_MEMBER") << status;
  }
  EXPECT_TRUE(engine_->use_cases().CancelJob(job, "").ok());
  EXPECT_TRUE(campaigns().Cancel(id, "").ok());
}

TEST_F(CampaignTest, AnExtendedCampaignIsTheLongerOne) {
  const std::string longer = Create(SmallCampaign(5, 10, 2));
  const CampaignRecord expected = WaitForEnd(longer);
  const std::string id = Create(SmallCampaign(3, 10, 2));
  InitialConditionSource more;
  more.draw = {.count = 2};
  EXPECT_EQ(campaigns().Extend(id, more, "", "").status().code(), absl::StatusCode::kFailedPrecondition);
  WaitForEnd(id);
  const auto extended = campaigns().Extend(id, more, "once", "");
  ASSERT_TRUE(extended.ok()) << extended.status();
  EXPECT_EQ(extended->state, CampaignState::kRunning);
  EXPECT_FALSE(extended->results);
  const auto again = campaigns().Extend(id, more, "once", "");
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ(again->of(MemberRole::kTuned).members, 5);
  const CampaignRecord record = WaitForEnd(id);
  EXPECT_EQ(record.results->mean_of, 5);
  EXPECT_EQ(record.results->mean_gains, expected.results->mean_gains);
  EXPECT_EQ(record.results->conclusion, expected.results->conclusion);
  ExpectWholeStory(id, 5, CampaignState::kSucceeded);
  EXPECT_EQ(record.spec.draws->count, 5);
}

TEST_F(CampaignTest, AFailingInitialConditionIsNamedAndTheOthersCount) {
  CampaignRequest request;
  request.job = JobOf(SmallScenario(5));
  Scenario scenario = *FindPreset("gto-geo");
  scenario.id = "mixed";
  scenario.horizon_samples = 40;
  scenario.integration_tolerance = 1e-6;
  scenario.search.iterations = 3;
  scenario.search.directions = 2;
  request.job = JobOf(scenario);
  request.initial_conditions.list = {scenario.chaser, FindPreset("gto-geo-printed")->chaser};
  const CampaignRecord record = WaitForEnd(Create(request));
  EXPECT_EQ(record.state, CampaignState::kSucceeded);
  EXPECT_EQ(record.results->mean_of, 1);
  EXPECT_THAT(record.results->conclusion, HasSubstr("initial condition 2 (jobs/"));
  EXPECT_THAT(record.results->conclusion, HasSubstr("domain"));
}

TEST_F(CampaignTest, FailsWhereEveryJobFails) {
  Scenario scenario = *FindPreset("gto-geo-printed");
  scenario.id = "lost";
  scenario.search.iterations = 2;
  scenario.search.directions = 2;
  CampaignRequest request;
  request.job = JobOf(scenario);
  request.initial_conditions.list = {scenario.chaser, scenario.chaser};
  const CampaignRecord record = WaitForEnd(Create(request));
  EXPECT_EQ(record.state, CampaignState::kFailed);
  EXPECT_THAT(record.error_message, HasSubstr("2 jobs did not succeed"));
  // More may be added to it all the same.
  InitialConditionSource more;
  more.list = {FindPreset("gto-geo")->chaser};
  ASSERT_TRUE(campaigns().Extend(record.id, more, "", "").ok());
  EXPECT_EQ(WaitForEnd(record.id).state, CampaignState::kSucceeded);
}

TEST_F(CampaignTest, AJobOfItsOwnGetsOnBesideACampaign) {
  CampaignRequest request = SmallCampaign(100);
  request.job = JobOf(EndlessScenario());
  const std::string id = Create(request);
  const std::string job = engine_->Create(SmallScenario(3));
  EXPECT_EQ(engine_->WaitForEnd(job).state, JobState::kSucceeded);
  const CampaignRecord record = *campaigns().Get(id);
  EXPECT_LE(record.of(MemberRole::kTuned).running, 4);
  EXPECT_TRUE(campaigns().Cancel(id, "").ok());
}

TEST_F(CampaignTest, EveryFaultIsNamed) {
  const auto fields = [&](const CampaignRequest& request) {
    return ViolatedFields(campaigns().Create(request, "", true).status());
  };
  CampaignRequest both = SmallCampaign(2);
  both.initial_conditions.list = {SmallScenario().chaser};
  EXPECT_THAT(fields(both), ElementsAre("campaign.initial_conditions"));
  CampaignRequest neither = SmallCampaign(2);
  neither.initial_conditions.draw.reset();
  EXPECT_THAT(fields(neither), ElementsAre("campaign.initial_conditions"));
  EXPECT_THAT(fields(SmallCampaign(0)), ElementsAre("campaign.initial_conditions.draw.count"));
  EXPECT_THAT(fields(SmallCampaign(10'001)), ElementsAre("campaign.initial_conditions.draw.count"));
  CampaignRequest without = SmallCampaign(2);
  without.initial_conditions.draw->distribution = {};
  without.job.scenario.definition->neighbourhood = {};
  EXPECT_THAT(fields(without), ElementsAre("campaign.initial_conditions.draw.distribution"));
  CampaignRequest upside_down = SmallCampaign(2);
  auto distribution = std::get<EquinoctialDistribution>(SmallNeighbourhood());
  distribution.ex = UniformVariate{1, 0};
  upside_down.initial_conditions.draw->distribution = distribution;
  ASSERT_EQ(fields(upside_down).size(), 1u);
  EXPECT_THAT(fields(upside_down)[0], HasSubstr("campaign.initial_conditions.draw.distribution.equinoctial.ex"));
  CampaignRequest hyperbola = SmallCampaign(2);
  hyperbola.initial_conditions = {};
  auto state = std::get<EquinoctialState>(SmallScenario().chaser);
  hyperbola.initial_conditions.list.push_back(state);
  state.ex = 1.5;
  hyperbola.initial_conditions.list.push_back(state);
  EXPECT_THAT(fields(hyperbola), ElementsAre("campaign.initial_conditions.list[1].equinoctial.ex"));
  CampaignRequest step = SmallCampaign(2);
  step.job.search.step_size = -1;
  EXPECT_THAT(fields(step), ElementsAre("campaign.hyperparameters.step_size"));
  CampaignRequest robust = SmallCampaign(2);
  robust.robust.emplace();
  robust.robust->objective = Objective{.aggregate = Aggregate::kCvar, .level = 2};
  EXPECT_THAT(fields(robust), ElementsAre("campaign.robust.objective.level"));
  CampaignRequest tune = SmallCampaign(2);
  tune.tune_held_out = true;
  EXPECT_THAT(fields(tune), ElementsAre("campaign.tune_held_out"));
  EXPECT_THAT(ViolatedFields(campaigns().Create(SmallCampaign(2), std::string(129, 'x'), true).status()),
              ElementsAre("request_id"));
  EXPECT_THAT(campaigns().List(0, "", {})->items, testing::IsEmpty());
}

TEST_F(CampaignTest, HeldOutOnesMayBeTunedToCompareWith) {
  CampaignRequest request = SmallCampaign(2, 8, 2);
  request.tune_held_out = true;
  const CampaignRecord record = WaitForEnd(Create(request));
  EXPECT_EQ(record.results->mean_of, 2);
  bool compared = false;
  for (const GainsComparison& c : record.results->comparisons) {
    compared = compared || (c.choice == GainsChoice::kTuned && c.over == MemberRole::kHeldOut && c.flown == 2);
  }
  EXPECT_TRUE(compared);
}

TEST_F(CampaignTest, ListsComeInPages) {
  std::vector<std::string> ids;
  for (int i = 0; i < 3; ++i) ids.push_back(Create(SmallCampaign(3, 1)));
  const auto first = campaigns().List(2, "", {});
  ASSERT_TRUE(first.ok());
  ASSERT_EQ(first->items.size(), 2u);
  EXPECT_EQ(first->items[0].id, ids[2]);
  const auto second = campaigns().List(2, first->next_page_token, {});
  ASSERT_EQ(second->items.size(), 1u);
  EXPECT_EQ(second->items[0].id, ids[0]);
  EXPECT_EQ(second->next_page_token, "");
  EXPECT_FALSE(campaigns().List(2, first->next_page_token, {CampaignState::kPaused}).ok());
  const auto members = campaigns().ListMembers(ids[0], 2, "");
  ASSERT_EQ(members->items.size(), 2u);
  const auto rest = campaigns().ListMembers(ids[0], 2, members->next_page_token);
  ASSERT_EQ(rest->items.size(), 1u);
  EXPECT_EQ(rest->items[0].member.id.number, 3);
}

}  // namespace
}  // namespace orbitune::server_test
