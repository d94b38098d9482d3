// What every store must do for campaigns: whole or not at all, in order, and with their jobs.
#include <gmock/gmock.h>

#include <cmath>
#include <future>

#include "absl/strings/str_cat.h"
#include "core/scenario/presets.h"
#include "tests/storage/job_store_conformance.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

CampaignSpec OddCampaign() {
  CampaignSpec spec;
  spec.display_name = "\"odd\" \xC3\xA9";
  spec.labels = {{"case", "1"}};
  spec.scenario = *FindPreset("leo-rendezvous");
  spec.warm_start = "jobs/warm";
  spec.owner = "ana";
  spec.draws =
      InitialConditionDraws{.distribution = KeplerianDistribution{.semi_major_axis_km = NormalVariate{7e3, 0.1},
                                                                  .eccentricity = UniformVariate{0, 0.1},
                                                                  .inclination_deg = FixedValue{81.3},
                                                                  .mirrored_periapsis = true},
                            .seed = ~std::uint64_t{0},
                            .count = 17};
  spec.held_out_draws = InitialConditionDraws{.distribution = EquinoctialDistribution{.p_km = FixedValue{7e3}}};
  spec.tune_held_out = true;
  spec.robust = RobustTuning{.objective = {.aggregate = Aggregate::kCvar, .level = 0.9, .relative_to_initial = true}};
  spec.robust->search.algorithm = Algorithm::kCmaEs;
  return spec;
}

NewMember MemberOf(const std::string& campaign, MemberRole role, int number, bool with_job = true) {
  NewMember member;
  member.member.id = {.role = role, .number = number};
  if (role != MemberRole::kRobust) {
    auto state = std::get<EquinoctialState>(FindPreset("leo-rendezvous")->chaser);
    state.p_km += 0.1 * number;
    member.member.initial_condition = state;
  }
  if (!with_job) return member;
  member.member.job_id = absl::StrCat(campaign, static_cast<int>(role), number);
  member.job = PlainSpec();
  member.job->campaign_id = campaign;
  return member;
}

// Two tuned members, one held out, one robust.
NewCampaign CampaignOf(const std::string& id, TimeUs time_us = 5) {
  return {.id = id,
          .spec = OddCampaign(),
          .members = {MemberOf(id, MemberRole::kTuned, 1), MemberOf(id, MemberRole::kTuned, 2),
                      MemberOf(id, MemberRole::kHeldOut, 1, false), MemberOf(id, MemberRole::kRobust, 1)},
          .time_us = time_us};
}

template <typename T>
T Wait(const std::function<void(std::function<void(T)>)>& write) {
  std::promise<T> answer;
  write([&answer](T value) { answer.set_value(std::move(value)); });
  return answer.get_future().get();
}

CampaignResults OddResults() {
  CampaignResults results{.mean_of = 2, .mean_gains = {0.1, 1 / 3.0, 1, 2, 3}, .conclusion = "so \"be\" it"};
  results.robust_gains = Gains{1, 2, 3, 4, 5.5};
  results.best_on_held_out = GainsChoice::kRobust;
  results.comparisons.push_back({.choice = GainsChoice::kMean, .over = MemberRole::kHeldOut, .flown = 3});
  results.comparisons[0].cost_percent = {
      .average = 1 / 7.0, .minimum = -3, .maximum = 9, .percentiles = {1, 2, 3, 4, 5}};
  return results;
}

TEST_P(CampaignStoreConformance, KeepsACampaignWithItsMembersAndJobs) {
  const auto written = Create(CampaignOf("c"));
  ASSERT_TRUE(written.ok()) << written.status();
  EXPECT_EQ(written->new_jobs.size(), 3u);
  Reopen();
  const auto record = campaigns().GetCampaign("c");
  ASSERT_TRUE(record.ok()) << record.status();
  EXPECT_EQ(record->state, CampaignState::kRunning);
  EXPECT_EQ(record->last_seq, 1);
  EXPECT_EQ(record->spec.display_name, OddCampaign().display_name);
  EXPECT_EQ(record->spec.draws->seed, ~std::uint64_t{0});
  const auto& distribution = std::get<KeplerianDistribution>(record->spec.draws->distribution);
  EXPECT_TRUE(distribution.mirrored_periapsis);
  EXPECT_EQ(std::get<NormalVariate>(distribution.semi_major_axis_km).standard_deviation, 0.1);
  EXPECT_EQ(record->spec.robust->objective.level, 0.9);
  EXPECT_EQ(record->of(MemberRole::kTuned).members, 2);
  EXPECT_EQ(record->of(MemberRole::kTuned).jobs, 2);
  EXPECT_EQ(record->of(MemberRole::kHeldOut).jobs, 0);
  const auto members = campaigns().ListMembers("c", {}, 10);
  ASSERT_EQ(members->size(), 4u);
  EXPECT_EQ(members->at(1).job_id, "c02");
  const NewMember given = MemberOf("c", MemberRole::kTuned, 2);
  EXPECT_EQ(std::get<EquinoctialState>(members->at(1).initial_condition).p_km,
            std::get<EquinoctialState>(given.member.initial_condition).p_km);
  EXPECT_EQ(members->at(2).job_id, "");
  EXPECT_TRUE(std::holds_alternative<std::monostate>(members->at(3).initial_condition));
  EXPECT_EQ(store().GetJob("c02")->spec.campaign_id, "c");
  EXPECT_EQ(campaigns().ListMembers("c", members->at(1).id, 1)->at(0).id.role, MemberRole::kHeldOut);
}

TEST_P(CampaignStoreConformance, CreatesAllOrNothing) {
  ASSERT_TRUE(storage_test::Create(store(), "c02").ok());  // the id of a member's job
  EXPECT_FALSE(Create(CampaignOf("c")).ok());
  EXPECT_EQ(campaigns().GetCampaign("c").status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(store().GetJob("c01").status().code(), absl::StatusCode::kNotFound);
  EXPECT_TRUE(Create(CampaignOf("d")).ok());
}

TEST_P(CampaignStoreConformance, ARequestIdSeenBeforeGivesTheEarlierCampaign) {
  NewCampaign campaign = CampaignOf("c");
  campaign.request_id = "r";
  campaign.request_digest = "one";
  ASSERT_TRUE(Create(campaign).ok());
  campaign = CampaignOf("d");
  campaign.request_id = "r";
  campaign.request_digest = "one";
  const auto again = Create(campaign);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ(again->record.id, "c");
  EXPECT_THAT(again->new_jobs, IsEmpty());
  campaign.request_digest = "two";
  EXPECT_EQ(Create(campaign).status().code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ((*campaigns().FindRequest("r", "one"))->id, "c");
  EXPECT_EQ(campaigns().FindRequest("r", "two").status().code(), absl::StatusCode::kAlreadyExists);
  EXPECT_FALSE(*campaigns().FindRequest("s", "one"));
  EXPECT_FALSE(*campaigns().FindRequest("", ""));
}

TEST_P(CampaignStoreConformance, KeepsEventsInOrderAndResultsWithTheEnd) {
  ASSERT_TRUE(Create(CampaignOf("c")).ok());
  const MemberEnded ended{
      .member = {MemberRole::kRobust, 1}, .job_id = "c21", .state = JobState::kFailed, .time_us = 9};
  EXPECT_EQ(Append("c", 3, ended).code(), absl::StatusCode::kInternal);
  ASSERT_TRUE(Append("c", 2, ended).ok());
  ASSERT_TRUE(Change("c", 3, {.state = CampaignState::kEvaluating, .time_us = 10}).ok());
  CampaignEnd end{.change = {.state = CampaignState::kSucceeded, .time_us = 11, .results = OddResults()}};
  end.evaluated.push_back({.id = {MemberRole::kTuned, 2}});
  end.evaluated[0].episodes.push_back({.choice = GainsChoice::kMean, .gains = {1, 2, 3, 4, 5}, .cost = 0.1});
  ASSERT_TRUE(Wait<absl::Status>([&](CampaignStore::Done done) {
                campaigns().EndCampaign("c", 4, end, std::move(done));
              }).ok());
  Reopen();
  const auto events = campaigns().ListCampaignEvents("c", 1, 10);
  ASSERT_EQ(events->size(), 3u);
  const auto& first = std::get<MemberEnded>(events->at(0).what);
  EXPECT_EQ(first.member, ended.member);
  EXPECT_EQ(first.job_id, "c21");
  EXPECT_EQ(first.state, JobState::kFailed);
  const auto& last = std::get<CampaignStateChange>(events->at(2).what);
  ASSERT_TRUE(last.results);
  EXPECT_EQ(last.results->conclusion, OddResults().conclusion);
  const auto record = campaigns().GetCampaign("c");
  EXPECT_EQ(record->end_time_us, 11);
  EXPECT_EQ(record->state_changes, 3);
  EXPECT_EQ(record->results->mean_gains, OddResults().mean_gains);
  EXPECT_EQ(record->results->robust_gains, OddResults().robust_gains);
  EXPECT_EQ(record->results->comparisons[0].cost_percent.average, 1 / 7.0);
  EXPECT_TRUE(std::isnan(record->results->comparisons[0].delta_v_percent.average));
  EXPECT_EQ(campaigns().ListMembers("c", {}, 10)->at(1).episodes[0].cost, 0.1);
  EXPECT_THAT(campaigns().ListMembers("c", {}, 10)->at(0).episodes, IsEmpty());
  EXPECT_THAT(*campaigns().ListUnfinishedCampaigns(), IsEmpty());
}

TEST_P(CampaignStoreConformance, AnExtensionAddsMembersAndTakesTheResultsBack) {
  ASSERT_TRUE(Create(CampaignOf("c")).ok());
  ASSERT_TRUE(Change("c", 2, {.state = CampaignState::kSucceeded, .time_us = 10, .results = OddResults()}).ok());
  CampaignExtension extension{.id = "c", .seq = 3, .spec = OddCampaign()};
  extension.spec.draws->count = 18;
  extension.members = {MemberOf("c", MemberRole::kTuned, 3)};
  extension.change = {.state = CampaignState::kRunning, .time_us = 12, .message = "more"};
  extension.request_id = "x";
  const auto extend = [&](CampaignStore::Written done) { campaigns().ExtendCampaign(extension, std::move(done)); };
  auto written = Wait<absl::StatusOr<WrittenCampaign>>(extend);
  ASSERT_TRUE(written.ok()) << written.status();
  EXPECT_EQ(written->new_jobs.size(), 1u);
  EXPECT_EQ(written->record.state, CampaignState::kRunning);
  EXPECT_EQ(written->record.spec.draws->count, 18);
  EXPECT_EQ(written->record.end_time_us, 0);
  EXPECT_FALSE(written->record.results);
  EXPECT_EQ(written->record.of(MemberRole::kTuned).members, 3);
  written = Wait<absl::StatusOr<WrittenCampaign>>(extend);
  ASSERT_TRUE(written.ok()) << written.status();
  EXPECT_THAT(written->new_jobs, IsEmpty());
  EXPECT_FALSE(std::get<CampaignStateChange>(campaigns().ListCampaignEvents("c", 1, 1)->at(0).what).results);
}

TEST_P(CampaignStoreConformance, DeletesACampaignWithItsJobsOnceTheyHaveEnded) {
  NewCampaign campaign = CampaignOf("c");
  campaign.request_id = "r";
  ASSERT_TRUE(Create(campaign).ok());
  ASSERT_TRUE(Change("c", 2, {.state = CampaignState::kCancelled, .time_us = 10}).ok());
  EXPECT_EQ(Delete("c").code(), absl::StatusCode::kFailedPrecondition);
  for (const char* const job : {"c01", "c02", "c21"}) {
    ASSERT_TRUE(storage_test::Change(store(), job, 2, ChangeTo(JobState::kCancelled)).ok());
  }
  EXPECT_EQ(campaigns().GetCampaign("c")->of(MemberRole::kTuned).ended, 2);
  ASSERT_TRUE(Delete("c").ok());
  EXPECT_EQ(Delete("c").code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(store().GetJob("c01").status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(campaigns().ListMembers("c", {}, 1).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(campaigns().ListCampaignEvents("c", 0, 1).status().code(), absl::StatusCode::kNotFound);
  EXPECT_FALSE(*campaigns().FindRequest("r", ""));
}

TEST_P(CampaignStoreConformance, ListsTheNewestFirstInPagesAndByState) {
  for (const auto& [id, time_us] : {std::pair{"a", 3}, std::pair{"b", 5}, std::pair{"c", 5}}) {
    ASSERT_TRUE(Create(CampaignOf(id, time_us)).ok());
  }
  ASSERT_TRUE(Change("b", 2, {.state = CampaignState::kPaused, .time_us = 10}).ok());
  const auto ids = [&](const CampaignQuery& query) {
    std::vector<std::string> found;
    const auto listed = campaigns().ListCampaigns(query);
    for (const CampaignRecord& record : *listed) found.push_back(record.id);
    return found;
  };
  EXPECT_THAT(ids({}), ElementsAre("c", "b", "a"));
  EXPECT_THAT(ids({.limit = 1}), ElementsAre("c"));
  EXPECT_THAT(ids({.after = CampaignQuery::Cursor{5, "c"}}), ElementsAre("b", "a"));
  EXPECT_THAT(ids({.states = {CampaignState::kPaused}}), ElementsAre("b"));
  EXPECT_EQ(campaigns().ListUnfinishedCampaigns()->front().id, "a");
}

TEST_P(CampaignStoreConformance, JobsOfCampaignsAreListedOnlyWhereAskedFor) {
  ASSERT_TRUE(Create(CampaignOf("c")).ok());
  ASSERT_TRUE(storage_test::Create(store(), "alone").ok());
  for (const auto order : {JobQuery::Order::kCreateTime, JobQuery::Order::kBestCost}) {
    JobQuery query{.order = order};
    ASSERT_EQ(store().ListJobs(query)->size(), 1u);
    EXPECT_EQ(store().ListJobs(query)->front().id, "alone");
    query.filter.campaign_id = "c";
    EXPECT_EQ(store().ListJobs(query)->size(), 3u);
  }
  EXPECT_EQ(store().ListUnfinishedJobs()->size(), 4u);
}

}  // namespace

absl::StatusOr<WrittenCampaign> CampaignStoreConformance::Create(const NewCampaign& campaign) {
  return Wait<absl::StatusOr<WrittenCampaign>>(
      [&](CampaignStore::Written done) { campaigns().CreateCampaign(campaign, std::move(done)); });
}

absl::Status CampaignStoreConformance::Append(const std::string& id, std::int64_t seq, const MemberEnded& ended) {
  return Wait<absl::Status>(
      [&](CampaignStore::Done done) { campaigns().AppendMemberEnded(id, seq, ended, std::move(done)); });
}

absl::Status CampaignStoreConformance::Change(const std::string& id, std::int64_t seq,
                                              const CampaignStateChange& change) {
  return Wait<absl::Status>(
      [&](CampaignStore::Done done) { campaigns().ChangeState(id, seq, change, std::move(done)); });
}

absl::Status CampaignStoreConformance::Delete(const std::string& id) {
  return Wait<absl::Status>([&](CampaignStore::Done done) { campaigns().DeleteCampaign(id, std::move(done)); });
}

}  // namespace orbitune::storage_test
