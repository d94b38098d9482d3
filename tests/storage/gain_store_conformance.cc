#include <gmock/gmock.h>

#include <map>

#include "absl/strings/str_cat.h"
#include "core/library/scenario_digest.h"
#include "core/scenario/presets.h"
#include "tests/storage/job_store_conformance.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<std::string> IdsOf(const absl::StatusOr<std::vector<GainSet>>& sets) {
  EXPECT_TRUE(sets.ok()) << sets.status();
  std::vector<std::string> ids;
  if (sets.ok()) {
    for (const GainSet& set : *sets) ids.push_back(set.id);
  }
  return ids;
}

// A job, run to its end with a gain set.
void Succeed(JobStore& store, const std::string& id) {
  ASSERT_TRUE(Create(store, id).ok());
  ASSERT_TRUE(Change(store, id, 2, ChangeTo(JobState::kRunning)).ok());
  ASSERT_TRUE(Append(store, id, 3, RecordOf(1)).ok());
  StateChange succeeded = ChangeTo(JobState::kSucceeded);
  succeeded.gain_set = PlainGainSet(id);
  ASSERT_TRUE(Change(store, id, 4, succeeded).ok());
}

TEST_P(GainStoreConformance, KeepsAGainSetWithAllItsFields) {
  GainSet general = OddGainSet("general");
  general.kind = GainSetKind::kMean;
  general.initial_condition = std::monostate();
  general.initial_error.reset();
  const std::vector<GainSet> sets = {OddGainSet("odd"), general, PlainGainSet("plain")};
  ASSERT_TRUE(AddGainSets(store(), sets).ok());
  for (const bool reopen : {false, true}) {
    if (reopen) Reopen();
    for (const GainSet& expected : sets) {
      const auto set = store().gains().GetGainSet(expected.id);
      ASSERT_TRUE(set.ok()) << set.status();
      EXPECT_EQ(Difference(*set, expected), "") << expected.id;
    }
    const auto listed = store().gains().ListGainSets({});
    ASSERT_TRUE(listed.ok()) << listed.status();
    ASSERT_EQ(listed->size(), 3u);
    EXPECT_EQ(Difference((*listed)[0], sets[0]), "");
  }
}

TEST_P(GainStoreConformance, AJobThatSucceedsLeavesItsGainSet) {
  Succeed(store(), "job");
  for (const bool reopen : {false, true}) {
    if (reopen) Reopen();
    const auto set = store().gains().GetGainSet("job");
    ASSERT_TRUE(set.ok()) << set.status();
    EXPECT_EQ(Difference(*set, PlainGainSet("job")), "");
  }
}

TEST_P(GainStoreConformance, AChangeThatIsRefusedLeavesNoGainSet) {
  ASSERT_TRUE(Create(store(), "job").ok());
  StateChange succeeded = ChangeTo(JobState::kSucceeded);
  succeeded.gain_set = PlainGainSet("job");
  EXPECT_FALSE(Change(store(), "job", 7, succeeded).ok());
  EXPECT_TRUE(absl::IsNotFound(store().gains().GetGainSet("job").status()));
  // Nor the other way round.
  ASSERT_TRUE(AddGainSets(store(), {PlainGainSet("job")}).ok());
  EXPECT_FALSE(Change(store(), "job", 2, succeeded).ok());
  const auto job = store().GetJob("job");
  ASSERT_TRUE(job.ok());
  EXPECT_EQ(job->state, JobState::kQueued);
  EXPECT_EQ(job->last_seq, 1);
}

TEST_P(GainStoreConformance, DeletingAJobKeepsItsGainSet) {
  Succeed(store(), "job");
  ASSERT_TRUE(Delete(store(), "job").ok());
  EXPECT_TRUE(absl::IsNotFound(store().GetJob("job").status()));
  EXPECT_TRUE(store().gains().GetGainSet("job").ok());
}

TEST_P(GainStoreConformance, AddsAllOrNone) {
  ASSERT_TRUE(AddGainSets(store(), {PlainGainSet("a")}).ok());
  const absl::Status status = AddGainSets(store(), {PlainGainSet("b"), PlainGainSet("a"), PlainGainSet("c")});
  EXPECT_FALSE(status.ok());
  EXPECT_THAT(IdsOf(store().gains().ListGainSets({})), ElementsAre("a"));
  EXPECT_TRUE(AddGainSets(store(), {}).ok());
}

TEST_P(GainStoreConformance, DeletesOne) {
  ASSERT_TRUE(AddGainSets(store(), {PlainGainSet("a"), PlainGainSet("b")}).ok());
  ASSERT_TRUE(DeleteGainSet(store(), "a").ok());
  const absl::Status again = DeleteGainSet(store(), "a");
  EXPECT_TRUE(absl::IsNotFound(again)) << again;
  EXPECT_THAT(std::string(again.message()), HasSubstr("\"a\""));
  EXPECT_TRUE(absl::IsNotFound(store().gains().GetGainSet("a").status()));
  EXPECT_THAT(IdsOf(store().gains().ListGainSets({})), ElementsAre("b"));
  ASSERT_TRUE(AddGainSets(store(), {PlainGainSet("a")}).ok());
}

TEST_P(GainStoreConformance, ListsByFilterNewestFirst) {
  std::vector<GainSet> sets;
  for (int i = 0; i < 8; ++i) {
    GainSet set = PlainGainSet(absl::StrCat("set", i), 10 + i / 2);
    set.kind = i % 2 == 0 ? GainSetKind::kTuned : GainSetKind::kRobust;
    set.scenario.id = i < 4 ? "leo" : "mine";
    set.job_id = absl::StrCat("job", i);
    set.campaign_id = i == 5 ? "campaign" : "";
    sets.push_back(set);
  }
  ASSERT_TRUE(AddGainSets(store(), sets).ok());
  const GainStore& gains = store().gains();
  EXPECT_THAT(IdsOf(gains.ListGainSets({})),
              ElementsAre("set7", "set6", "set5", "set4", "set3", "set2", "set1", "set0"));
  EXPECT_THAT(IdsOf(gains.ListGainSets({.scenario_ids = {"leo"}})), ElementsAre("set3", "set2", "set1", "set0"));
  EXPECT_THAT(IdsOf(gains.ListGainSets({.kinds = {GainSetKind::kRobust}, .scenario_ids = {"mine"}})),
              ElementsAre("set7", "set5"));
  EXPECT_THAT(IdsOf(gains.ListGainSets({.job_ids = {"job2", "job3"}})), ElementsAre("set3", "set2"));
  EXPECT_THAT(IdsOf(gains.ListGainSets({.campaign_ids = {"campaign"}})), ElementsAre("set5"));
  EXPECT_THAT(IdsOf(gains.ListGainSets({.kinds = {GainSetKind::kMean}})), IsEmpty());

  std::vector<std::string> paged;
  GainSetQuery query{.limit = 3};
  while (true) {
    const auto page = gains.ListGainSets(query);
    ASSERT_TRUE(page.ok()) << page.status();
    if (page->empty()) break;
    for (const GainSet& set : *page) paged.push_back(set.id);
    query.after = {page->back().create_time_us, page->back().id};
  }
  EXPECT_EQ(paged, IdsOf(gains.ListGainSets({})));
}

TEST_P(GainStoreConformance, ReadsTheLibraryShelfByShelf) {
  GainSet general = PlainGainSet("general");
  general.kind = GainSetKind::kMean;
  general.initial_error.reset();
  ASSERT_TRUE(AddGainSets(store(), {PlainGainSet("z"), OddGainSet("odd"), PlainGainSet("a"), general}).ok());
  std::map<std::string, std::vector<LibraryEntry>> shelves;
  const absl::Status status = store().gains().ReadLibrary(
      [&](const std::string& digest, const Scenario& definition, const std::vector<LibraryEntry>& entries) {
        EXPECT_EQ(ScenarioDigest(definition), digest);
        EXPECT_TRUE(shelves.emplace(digest, entries).second);
      });
  ASSERT_TRUE(status.ok()) << status;
  ASSERT_EQ(shelves.size(), 2u);
  const auto& leo = shelves[ScenarioDigest(*FindPreset("leo-rendezvous"))];
  ASSERT_EQ(leo.size(), 3u);
  EXPECT_EQ(leo[0].id, "z");  // as stored
  EXPECT_EQ(leo[0].gains, PlainGainSet("z").gains);
  EXPECT_EQ(leo[0].initial_error->x1, 0.01);
  EXPECT_EQ(leo[2].kind, GainSetKind::kMean);
  EXPECT_FALSE(leo[2].initial_error);
}

}  // namespace
}  // namespace orbitune::storage_test
