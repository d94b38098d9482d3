// What every store must do so that old things can be removed: tell what is old, and take iterations from a job so that
// every read says so.
#include <gmock/gmock.h>

#include <chrono>
#include <future>
#include <thread>

#include "absl/strings/str_cat.h"
#include "tests/storage/job_store_conformance.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

absl::Status RemoveIterations(JobStore& store, const std::string& id, TimeUs now = 99) {
  std::promise<absl::Status> answer;
  store.retention().RemoveIterations(id, now, [&](absl::Status status) { answer.set_value(std::move(status)); });
  return answer.get_future().get();
}

std::vector<std::string> IdsOf(const absl::StatusOr<std::vector<RetentionStore::Ended>>& ended) {
  EXPECT_TRUE(ended.ok()) << ended.status();
  std::vector<std::string> ids;
  for (const auto& one : *ended) ids.push_back(one.id);
  return ids;
}

// Iterations 1 to n, with a pause behind the first two; the best is in their middle.
void MakeEnded(JobStore& store, const std::string& id, int n, TimeUs end_us) {
  ASSERT_TRUE(Create(store, id).ok());
  std::int64_t seq = 1;
  for (int i = 1; i <= n; ++i) {
    if (i == 3) {
      ASSERT_TRUE(Change(store, id, ++seq, ChangeTo(JobState::kPaused, 5)).ok());
    }
    IterationRecord record = RecordWith(i, Outcome::kSettled, i == n / 2 ? 1 : 100 + i);
    store.AppendIteration(id, ++seq, record, {}, [](const absl::Status& s) { EXPECT_TRUE(s.ok()) << s; });
  }
  ASSERT_TRUE(Change(store, id, ++seq, ChangeTo(JobState::kCancelled, end_us)).ok());
}

TEST_P(RetentionConformance, ListsWhatEndedTheOldestFirst) {
  MakeEnded(store(), "later", 10, 300);
  MakeEnded(store(), "earlier", 10, 200);
  MakeEnded(store(), "short", 3, 100);
  ASSERT_TRUE(Create(store(), "unfinished").ok());
  const RetentionStore& old = store().retention();
  EXPECT_THAT(IdsOf(old.JobsEndedBefore(1000, 10)), ElementsAre("short", "earlier", "later"));
  EXPECT_THAT(IdsOf(old.JobsEndedBefore(300, 10)), ElementsAre("short", "earlier"));
  EXPECT_THAT(IdsOf(old.JobsEndedBefore(1000, 1)), ElementsAre("short"));
  EXPECT_THAT(IdsOf(old.HistoriesEndedBefore(1000, 10)), ElementsAre("earlier", "later"));  // short has no others
  EXPECT_THAT(IdsOf(old.CampaignsEndedBefore(1000, 10)), IsEmpty());
}

TEST_P(RetentionConformance, AJobWithoutItsIterationsSaysSo) {
  MakeEnded(store(), "a", 5000, 200);
  const JobRecord before = *store().GetJob("a");
  const auto all = *store().ListEvents("a", 0, 10'000);
  const auto bytes = store().retention().GetUsage()->bytes;
  ASSERT_TRUE(RemoveIterations(store(), "a", 77).ok());
  for (const bool from_disk : {false, true}) {
    const JobRecord after = *store().GetJob("a");
    EXPECT_EQ(after.iterations_removed_us, 77);
    EXPECT_EQ(after.completed_iterations(), 5000);
    EXPECT_TRUE(Identical(*after.first, *before.first));
    EXPECT_TRUE(Identical(*after.best, *before.best));
    EXPECT_TRUE(Identical(*after.latest, *before.latest));
    for (const absl::Status& status :
         {store().ListIterations("a", 0, 10).status(), store().ListIterations("a", 4999, 10).status(),
          store().SampleIterations("a", {}, 100).status()}) {
      EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
      EXPECT_EQ(ReasonOf(status), "ITERATIONS_REMOVED");
    }
    // The events that are left have the seqs that they had.
    const auto left = store().ListEvents("a", 0, 100);
    ASSERT_TRUE(left.ok()) << left.status();
    std::vector<std::int64_t> seqs;
    for (const JobEvent& event : *left) {
      seqs.push_back(event.seq);
      EXPECT_EQ(Difference(event, all[static_cast<std::size_t>(event.seq - 1)]), "") << event.seq;
    }
    EXPECT_THAT(seqs, ElementsAre(1, 2, 4, 2502, 5002, 5003));
    EXPECT_THAT(*store().ListEvents("a", 2502, 1), ::testing::SizeIs(1));
    EXPECT_EQ(store().ListEvents("a", 2502, 1)->front().seq, 5002);
    EXPECT_THAT(*store().ListEvents("a", 5003, 10), IsEmpty());
    if (!from_disk) AwaitRemoval();
  }
  EXPECT_LT(store().retention().GetUsage()->bytes, bytes / 2);
  EXPECT_THAT(IdsOf(store().retention().HistoriesEndedBefore(1000, 10)), IsEmpty());
  // It can be deleted as any other, and what was not removed goes with it.
  ASSERT_TRUE(Delete(store(), "a").ok());
  AwaitRemoval();
}

TEST_P(RetentionConformance, WhatHasNotEndedKeepsItsIterations) {
  CreateWithIterations(store(), "a", 10);
  const absl::Status status = RemoveIterations(store(), "a");
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
  EXPECT_TRUE(absl::IsNotFound(RemoveIterations(store(), "none")));
  EXPECT_EQ(store().ListIterations("a", 0, 100)->size(), 10u);
  EXPECT_FALSE(store().retention().GetUsage()->removing);
}

TEST_P(RetentionConformance, WhatIsLeftSurvivesARestart) {
  MakeEnded(store(), "a", 3000, 200);
  ASSERT_TRUE(RemoveIterations(store(), "a").ok());
  Reopen();
  AwaitRemoval();
  EXPECT_EQ(store().GetJob("a")->iterations_removed_us, 99);
  EXPECT_EQ(store().ListEvents("a", 0, 100)->size(), 6u);
}

}  // namespace

void RetentionConformance::AwaitRemoval() {
  for (int i = 0; i < 6000 && store().retention().GetUsage()->removing; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_FALSE(store().retention().GetUsage()->removing);
}

}  // namespace orbitune::storage_test
