// What is particular to the SQLite store: its size on disk, leftovers of deleted jobs, locks, indexes.
#include "storage/sqlite_store.h"

#include <gtest/gtest.h>

#include <chrono>
#include <numeric>
#include <thread>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "storage/sqlite_list_query.h"
#include "tests/storage/sqlite_support.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

using std::chrono::steady_clock;

class SqliteStoreTest : public testing::Test {
 protected:
  std::string Database() const { return directory_.File("orbitune.db"); }

  TemporaryDirectory directory_;
};

bool WaitUntil(const std::function<bool()>& condition) {
  const auto end = steady_clock::now() + std::chrono::seconds(60);
  while (!condition()) {
    if (steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return true;
}

// The gains and costs of a real search fill all their bits; so do RecordOf's.
TEST_F(SqliteStoreTest, FiveThousandIterationsTakeLittleRoom) {
  CreateWithIterations(*OpenStore(Database()), "a", 5000);
  const auto one = std::filesystem::file_size(Database());
  EXPECT_LT(one, 700'000);
  // Jobs that grow side by side take no more.
  auto store = OpenStore(Database());
  for (int j = 0; j < 4; ++j) ASSERT_TRUE(Create(*store, absl::StrCat("job-", j)).ok());
  for (int i = 1; i <= 5000; ++i) {
    for (int j = 0; j < 4; ++j)
      store->AppendIteration(absl::StrCat("job-", j), i + 1, RecordOf(i), {}, [](const auto&) {});
  }
  store.reset();
  EXPECT_LT((std::filesystem::file_size(Database()) - one) / 4, 700'000);
  RecordProperty("bytes_per_iteration", static_cast<int>(std::filesystem::file_size(Database()) / 25'000));
}

// The time only sets the bound, so that a slow machine has a wider one. Without gathering there are over 400.
TEST_F(SqliteStoreTest, IterationsThatNobodyWaitsForShareCommits) {
  StoreMetrics metrics;
  const auto store = *OpenSqliteStore({.path = Database(), .metrics = &metrics});
  ASSERT_TRUE(Create(*store, "a").ok());
  const auto commits = [&] {
    const auto counts = metrics.commit_s.Read().counts;
    return std::accumulate(counts.begin(), counts.end(), 0.0);
  };
  const double before = commits();
  const auto begun = steady_clock::now();
  constexpr int kIterations = 500;
  for (int i = 1; i <= kIterations; ++i) {
    store->AppendIteration("a", i + 1, RecordOf(i), {}, [](const absl::Status& status) { EXPECT_TRUE(status.ok()); });
    if (i > 10) std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  store->Flush();
  const std::chrono::duration<double, std::milli> taken = steady_clock::now() - begun;
  EXPECT_LE(commits() - before, taken.count() / 16 + kIterations / 256.0 + 5);
  EXPECT_EQ(store->GetJob("a")->completed_iterations(), kIterations);
}

TEST_F(SqliteStoreTest, CanBeReadWithSqliteAlone) {
  const auto store = OpenStore(Database());
  CreateWithIterations(*store, "a", 10);
  EXPECT_EQ(QueryInt(Database(),
                     "SELECT count(*) FROM jobs JOIN iterations ON job = key "
                     "WHERE id = 'a' AND state = 'QUEUED' AND k2 = sqrt(iteration)"),
            10);
  EXPECT_EQ(QueryInt(Database(), "SELECT spec ->> '$.scenario.search.iterations' FROM job_documents"), 5000);
}

TEST_F(SqliteStoreTest, RemovesTheIterationsOfDeletedJobsInIdleTime) {
  const auto store = OpenStore(Database());
  CreateWithIterations(*store, "a", 9000);
  CreateWithIterations(*store, "b", 10);
  CreateWithIterations(*store, "c", 0);
  ASSERT_TRUE(Delete(*store, "a").ok());
  ASSERT_TRUE(Delete(*store, "c").ok());
  EXPECT_TRUE(WaitUntil([&] { return QueryInt(Database(), "SELECT count(*) FROM iterations") == 10; }));
  EXPECT_TRUE(WaitUntil([&] { return QueryInt(Database(), "SELECT count(*) FROM deleted_jobs") == 0; }));
  EXPECT_EQ(store->ListIterations("b", 0, 100)->size(), 10);
  for (const char* table : {"job_documents", "job_events"}) {
    EXPECT_EQ(QueryInt(Database(), absl::StrCat("SELECT count(*) FROM ", table)), 1) << table;
  }
}

TEST_F(SqliteStoreTest, RemovesLeftoversOfAnEarlierRun) {
  auto store = OpenStore(Database());
  CreateWithIterations(*store, "a", 9000);
  ASSERT_TRUE(Delete(*store, "a").ok());
  store.reset();  // at once: most are still there
  const auto left = QueryInt(Database(), "SELECT count(*) FROM iterations");
  store = OpenStore(Database());
  EXPECT_TRUE(WaitUntil([&] { return QueryInt(Database(), "SELECT count(*) FROM iterations") == 0; })) << left;
  CreateWithIterations(*store, "a", 3);
  EXPECT_EQ(store->ListIterations("a", 0, 10)->size(), 3);
}

// Somebody's shell holds the file: writes wait and say why, reads go on, and nothing is lost.
TEST_F(SqliteStoreTest, WaitsForAnotherProcessesLock) {
  const auto store = OpenStore(Database());
  CreateWithIterations(*store, "a", 1);
  auto shell = Connection::Open(Database(), Connection::Mode::kReadWrite);
  ASSERT_TRUE(shell.ok()) << shell.status();
  ASSERT_TRUE((*shell)->Execute("BEGIN IMMEDIATE").ok());
  std::atomic<int> answered = 0;
  store->AppendIteration("a", 3, RecordOf(2), {}, [&](const absl::Status& status) { answered = status.ok() ? 1 : 2; });
  EXPECT_TRUE(WaitUntil([&] { return !store->ok_for_now().ok(); }));
  EXPECT_TRUE(absl::StrContains(store->ok_for_now().message(), "locked")) << store->ok_for_now();
  EXPECT_EQ(answered, 0);
  EXPECT_EQ(store->GetJob("a")->last_seq, 2);
  ASSERT_TRUE((*shell)->Execute("COMMIT").ok());
  store->Flush();
  EXPECT_EQ(answered, 1);
  EXPECT_TRUE(store->ok_for_now().ok());
  EXPECT_EQ(store->GetJob("a")->last_seq, 3);
}

// A damaged job is refused by itself: the others in its group are written.
TEST_F(SqliteStoreTest, OneDamagedJobDoesNotHoldUpTheOthers) {
  const auto store = OpenStore(Database());
  CreateWithIterations(*store, "a", 3);
  CreateWithIterations(*store, "b", 3);
  auto shell = Connection::Open(Database(), Connection::Mode::kReadWrite);
  ASSERT_TRUE(shell.ok()) << shell.status();
  // The next iteration of a is there already, which is an error of SQLite's in the middle of the group.
  ASSERT_TRUE((*shell)->Execute("UPDATE jobs SET iterations = 2, last_seq = 3 WHERE id = 'a'").ok());
  std::vector<absl::StatusCode> codes;
  const auto done = [&codes](const absl::Status& status) { codes.push_back(status.code()); };
  store->AppendIteration("b", 5, RecordOf(4), {}, done);
  store->AppendIteration("a", 4, RecordOf(3), {}, done);
  store->AppendIteration("b", 6, RecordOf(5), {}, done);
  store->Flush();
  using enum absl::StatusCode;
  EXPECT_EQ(codes, (std::vector{kOk, kInternal, kOk}));
  EXPECT_EQ(store->GetJob("b")->completed_iterations(), 5);
  EXPECT_TRUE(store->ok_for_now().ok());
  // And what reads it is told.
  ASSERT_TRUE((*shell)->Execute("DELETE FROM iterations WHERE job = 2 AND iteration = 2").ok());
  EXPECT_TRUE(absl::IsDataLoss(store->ListEvents("b", 0, 100).status()));
  ASSERT_TRUE((*shell)->Execute("UPDATE job_documents SET spec = '{}' WHERE job = 2").ok());
  const absl::Status status = store->GetJob("b").status();
  EXPECT_TRUE(absl::IsDataLoss(status));
  EXPECT_TRUE(absl::StrContains(status.message(), "job b: damaged document: spec.display_name is missing")) << status;
}

TEST_F(SqliteStoreTest, ListsInTheOrderOfAnIndex) {
  OpenStore(Database()).reset();
  auto connection = Connection::Open(Database(), Connection::Mode::kReadOnly);
  ASSERT_TRUE(connection.ok()) << connection.status();
  for (const auto order : {JobQuery::Order::kCreateTime, JobQuery::Order::kBestCost}) {
    for (const bool descending : {false, true}) {
      JobQuery query{.filter = {}, .order = order, .descending = descending, .limit = 50, .after = {}};
      query.after = {.key = 1, .id = "a"};
      for (const ListQuery& stretch : MakeListQueries(query)) {
        auto plan = (*connection)
                        ->PrepareOnce(
                            "EXPLAIN QUERY PLAN SELECT state, spec FROM jobs JOIN job_documents ON "
                            "job_documents.job = jobs.key" +
                            stretch.tail);
        ASSERT_TRUE(plan.ok()) << plan.status();
        std::string text;
        ASSERT_TRUE(plan->BindAll(stretch.values)
                        .ForEachRow([&] {
                          text += plan->Text(3) + "\n";
                          return absl::OkStatus();
                        })
                        .ok());
        EXPECT_FALSE(absl::StrContains(text, "TEMP B-TREE")) << text;
        EXPECT_TRUE(absl::StrContains(text, "SEARCH jobs USING INDEX jobs_by")) << text;
      }
    }
  }
}

// The last page of many is as quick as the first.
TEST_F(SqliteStoreTest, PagesThroughTenThousandJobs) {
#ifdef __SANITIZE_THREAD__
  constexpr int kJobs = 1000;  // reading a document takes ten times as long
#else
  constexpr int kJobs = 10'000;
#endif
  const auto store = OpenStore(Database());
  for (int j = 0; j < kJobs; ++j) {
    store->CreateJob(absl::StrCat("job-", j), PlainSpec(), j / 3, "", "",
                     [](const auto& job) { EXPECT_TRUE(job.ok()); });
  }
  store->Flush();
  for (const auto order : {JobQuery::Order::kCreateTime, JobQuery::Order::kBestCost}) {
    JobQuery query{.filter = {}, .order = order, .descending = true, .limit = 500, .after = {}};
    int seen = 0;
    const auto begin = steady_clock::now();
    for (auto page = store->ListJobs(query); !page->empty(); page = store->ListJobs(query)) {
      seen += static_cast<int>(page->size());
      const bool by_time = order == JobQuery::Order::kCreateTime;
      query.after = {.key = by_time ? static_cast<double>(page->back().create_time_us) : kUnset, .id = page->back().id};
    }
    const std::chrono::duration<double, std::milli> took = steady_clock::now() - begin;
    EXPECT_EQ(seen, kJobs);
    RecordProperty(absl::StrCat("ms_order_", static_cast<int>(order)), static_cast<int>(took.count()));
  }
}

}  // namespace
}  // namespace orbitune::storage_test
