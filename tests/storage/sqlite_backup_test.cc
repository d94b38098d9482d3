// Copies of a database, taken while it is written to and put back; and what is found in damaged ones.
#include "storage/sqlite_backup.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "absl/strings/str_cat.h"
#include "storage/sqlite_store.h"
#include "tests/storage/faulty_disk.h"
#include "tests/storage/sqlite_support.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class SqliteBackup : public testing::Test {
 protected:
  std::string Database() const { return directory_.File("orbitune.db"); }
  std::string Backup() const { return directory_.File("backup.db"); }
  std::vector<std::string> FaultsIn(const std::string& path) {
    auto connection = Connection::Open(path, Connection::Mode::kReadOnly);
    EXPECT_TRUE(connection.ok()) << connection.status();
    const auto faults = FindFaults(**connection);
    EXPECT_TRUE(faults.ok()) << faults.status();
    return faults.value_or(std::vector<std::string>());
  }
  void Execute(const std::string& script) {
    auto connection = Connection::Open(Database(), Connection::Mode::kReadWrite);
    ASSERT_TRUE(connection.ok()) << connection.status();
    const absl::Status status = (*connection)->Execute(script);
    ASSERT_TRUE(status.ok()) << status;
  }
  std::set<std::string> Files() const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(directory_.path()))
      names.insert(entry.path().filename());
    // What a reader leaves beside a database in use belongs to that.
    for (const char* name : {"orbitune.db-wal", "orbitune.db-shm"}) names.erase(name);
    return names;
  }

  TemporaryDirectory directory_;
};

// Whatever is written meanwhile, a backup is one moment's state, and has all that was acknowledged before it began.
TEST_F(SqliteBackup, IsOneMomentOfADatabaseInUse) {
  const auto store = OpenStore(Database());
  for (const char* id : {"a", "b"}) ASSERT_TRUE(Create(*store, id).ok());
  std::atomic<bool> stop = false;
  std::atomic<int> answered = 0;
  std::thread writer([&] {
    for (int i = 1; !stop; ++i) {
      // Of both jobs in one commit or in two, "a" first.
      store->AppendIteration("a", i + 1, RecordOf(i), {}, [](const absl::Status& s) { EXPECT_TRUE(s.ok()) << s; });
      ASSERT_TRUE(Append(*store, "b", i + 1, RecordOf(i)).ok());
      answered = i;
    }
  });
  for (int n = 0; n < 5; ++n) {
    while (answered < 20 * n) std::this_thread::yield();
    const int before = answered;
    const std::string path = directory_.File(absl::StrCat("backup", n, ".db"));
    const auto summary = BackUpDatabase(Database(), path);
    ASSERT_TRUE(summary.ok()) << summary.status();
    EXPECT_EQ(summary->jobs, 2);
    EXPECT_EQ(summary->unfinished_jobs, 2);
    EXPECT_GE(summary->iterations, 2 * before);
    const TemporaryDirectory elsewhere;
    ASSERT_TRUE(RestoreDatabase(path, elsewhere.File("orbitune.db")).ok());
    const auto copy = OpenStore(elsewhere.File("orbitune.db"));
    const int a = copy->GetJob("a")->completed_iterations();
    const int b = copy->GetJob("b")->completed_iterations();
    EXPECT_TRUE(a == b || a == b + 1) << a << " " << b;
    EXPECT_GE(b, before);
    const auto records = copy->ListIterations("b", 0, b);
    ASSERT_EQ(static_cast<int>(records->size()), b);
    for (int i = 1; i <= b; ++i) ASSERT_TRUE(Identical((*records)[static_cast<std::size_t>(i - 1)], RecordOf(i)));
  }
  stop = true;
  writer.join();
}

TEST_F(SqliteBackup, OverwritesNothingAndLeavesNothingHalf) {
  CreateWithIterations(*OpenStore(Database()), "a", 10);
  SetFileContents(Backup(), "mine");
  EXPECT_TRUE(absl::IsAlreadyExists(BackUpDatabase(Database(), Backup()).status()));
  EXPECT_EQ(FileContents(Backup()), "mine");
  EXPECT_TRUE(absl::IsNotFound(BackUpDatabase(directory_.File("none.db"), directory_.File("b.db")).status()));
  EXPECT_FALSE(BackUpDatabase(Database(), directory_.File("none/b.db")).ok());
  {
    FaultyDisk disk;
    disk.Set(FaultyDisk::Fault::kFull);
    EXPECT_TRUE(absl::IsUnavailable(BackUpDatabase(Database(), directory_.File("c.db")).status()));
  }
  EXPECT_EQ(Files(), (std::set<std::string>{"backup.db", "orbitune.db", "orbitune.lock"}));
}

TEST_F(SqliteBackup, ARestoreKeepsWhatWasThere) {
  CreateWithIterations(*OpenStore(Database()), "old", 10);
  ASSERT_TRUE(BackUpDatabase(Database(), Backup()).ok());
  CreateWithIterations(*OpenStore(Database()), "new", 20);
  const auto restored = RestoreDatabase(Backup(), Database());
  ASSERT_TRUE(restored.ok()) << restored.status();
  EXPECT_EQ(restored->summary.jobs, 1);
  EXPECT_THAT(restored->kept, HasSubstr("orbitune-replaced-"));
  EXPECT_TRUE(absl::IsNotFound(OpenStore(Database())->GetJob("new").status()));
  // And back again.
  ASSERT_TRUE(RestoreDatabase(restored->kept, Database()).ok());
  EXPECT_EQ(OpenStore(Database())->GetJob("new")->completed_iterations(), 20);
}

// One that a killed server left has a log beside it: a restore must neither lose that nor have it applied to another.
TEST_F(SqliteBackup, ARestoreKeepsTheLogOfACrashedServer) {
  const TemporaryDirectory elsewhere;
  CreateWithIterations(*OpenStore(elsewhere.File("orbitune.db")), "other", 5);
  {
    const auto store = OpenStore(Database());
    CreateWithIterations(*store, "a", 300);
    for (const char* suffix : {"", "-wal"}) {
      std::filesystem::copy(Database() + suffix, elsewhere.File(absl::StrCat("crashed.db", suffix)));
    }
  }
  ASSERT_GT(std::filesystem::file_size(elsewhere.File("crashed.db-wal")), 0u);
  const auto restored = RestoreDatabase(elsewhere.File("orbitune.db"), elsewhere.File("crashed.db"));
  ASSERT_TRUE(restored.ok()) << restored.status();
  EXPECT_TRUE(OpenStore(elsewhere.File("crashed.db"))->GetJob("other").ok());
  EXPECT_EQ(OpenStore(restored->kept)->GetJob("a")->completed_iterations(), 300);
}

TEST_F(SqliteBackup, ARestoreIsRefusedBeforeAnythingIsTouched) {
  {
    const auto store = OpenStore(Database());
    CreateWithIterations(*store, "a", 300);
    ASSERT_TRUE(BackUpDatabase(Database(), Backup()).ok());
    const absl::Status in_use = RestoreDatabase(Backup(), Database()).status();
    EXPECT_TRUE(absl::IsFailedPrecondition(in_use)) << in_use;
    EXPECT_THAT(std::string(in_use.message()), HasSubstr("another server"));
  }
  const std::string before = FileContents(Database());
  EXPECT_TRUE(absl::IsNotFound(RestoreDatabase(directory_.File("none.db"), Database()).status()));
  EXPECT_TRUE(absl::IsFailedPrecondition(RestoreDatabase(Database(), Database()).status()));
  std::string damaged = FileContents(Backup());
  damaged.replace(damaged.size() / 2, 3000, 3000, 'x');
  SetFileContents(directory_.File("damaged.db"), damaged);
  EXPECT_TRUE(absl::IsDataLoss(RestoreDatabase(directory_.File("damaged.db"), Database()).status()));
  SetFileContents(directory_.File("text.db"), std::string(9000, 'x'));
  EXPECT_TRUE(absl::IsDataLoss(RestoreDatabase(directory_.File("text.db"), Database()).status()));
  SetFileContents(directory_.File("empty.db"), "");
  EXPECT_TRUE(absl::IsFailedPrecondition(RestoreDatabase(directory_.File("empty.db"), Database()).status()));
  EXPECT_EQ(FileContents(Database()), before);
  EXPECT_THAT(Files(), Not(Contains(HasSubstr("restoring"))));
  EXPECT_THAT(Files(), Not(Contains(HasSubstr("replaced"))));
}

TEST_F(SqliteBackup, ACheckFindsWhatDoesNotFitTogether) {
  CreateWithIterations(*OpenStore(Database()), "a", 10);
  EXPECT_THAT(FaultsIn(Database()), IsEmpty());
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"DELETE FROM iterations WHERE iteration = 4", "jobs/a: 10 iterations are recorded, 9 are there"},
      {"UPDATE jobs SET last_seq = 12", "jobs/a: the last event is 12"},
      {"DELETE FROM job_events", "jobs/a: 1 state changes are recorded, 0 are there"},
      {"UPDATE job_documents SET spec = '{'", "jobs/a: its inputs are missing, or no JSON"},
      {"PRAGMA foreign_keys = OFF; UPDATE job_documents SET job = 77", "a row of job_documents refers to"},
      {"INSERT INTO iterations SELECT 99, iteration, k1, k2, k3, k4, k5, cost, settling_samples, fuel_sum, outcome, "
       "cost_std, pairs_left_out, pairs_not_settled, episodes FROM iterations",
       "10 iterations belong to no job"},
      {"PRAGMA writable_schema = ON; DELETE FROM sqlite_schema WHERE name = 'jobs_by_state'", "is never used"}};
  const std::string whole = FileContents(Database());
  for (const auto& [harm, words] : cases) {
    SetFileContents(Database(), whole);
    Execute(harm);
    EXPECT_THAT(FaultsIn(Database()), Contains(HasSubstr(words))) << harm;
    EXPECT_TRUE(absl::IsDataLoss(BackUpDatabase(Database(), Backup()).status())) << harm;
  }
}

// As its killed server leaves it: with a log.
void LeaveUnclosed(const std::string& path, int iterations) {
  const TemporaryDirectory elsewhere;
  const auto store = OpenStore(elsewhere.File("orbitune.db"));
  CreateWithIterations(*store, "a", iterations);
  for (const char* suffix : {"", "-wal"}) std::filesystem::copy(elsewhere.File("orbitune.db") + suffix, path + suffix);
}

TEST_F(SqliteBackup, AStartAfterACrashChecksTheDatabase) {
  LeaveUnclosed(Database(), 100);
  std::vector<std::string> told;
  SqliteStoreOptions options{.path = Database(), .log = [&](const std::string& text) { told.push_back(text); }};
  EXPECT_TRUE(OpenSqliteStore(options).ok());
  ASSERT_EQ(told.size(), 1u);
  EXPECT_THAT(told[0], HasSubstr("no damage"));
  // Closed well: nothing to check.
  EXPECT_TRUE(OpenSqliteStore(options).ok());
  EXPECT_EQ(told.size(), 1u);
}

TEST_F(SqliteBackup, ADamagedDatabaseIsRefusedWithAWayForward) {
  CreateWithIterations(*OpenStore(Database()), "a", 3000);
  SetFileContents(directory_.File("orbitune-schema1-20260101T000000Z.db"), "a backup");
  // A page in the middle of the iterations: found by a full check.
  std::string contents = FileContents(Database());
  contents.replace(contents.size() / 2 / 4096 * 4096, 4096, 4096, 'x');
  SetFileContents(Database(), contents);
  const absl::Status status =
      OpenSqliteStore({.path = Database(), .start_check = SqliteStoreOptions::StartCheck::kFull}).status();
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  for (const char* words : {"orbituned check", "orbituned restore", "orbitune-schema1-20260101T000000Z.db"}) {
    EXPECT_THAT(std::string(status.message()), HasSubstr(words));
  }
  EXPECT_EQ(FileContents(Database()), contents);
}

TEST_F(SqliteBackup, AQuickCheckEndsInTime) {
  CreateWithIterations(*OpenStore(Database()), "a", 20'000);
  auto connection = Connection::Open(Database(), Connection::Mode::kReadOnly);
  ASSERT_TRUE(connection.ok());
  EXPECT_EQ(*QuickCheck(**connection, std::chrono::milliseconds(0)), true);
  EXPECT_EQ(*QuickCheck(**connection, std::chrono::milliseconds(600'000)), true);
  bool cut = false;
  for (int i = 0; i < 50 && !cut; ++i) {
    const auto whole = QuickCheck(**connection, std::chrono::milliseconds(1));
    ASSERT_TRUE(whole.ok()) << whole.status();
    cut = !*whole;
  }
  EXPECT_TRUE(cut);
  EXPECT_EQ(*QuickCheck(**connection, std::chrono::milliseconds(0)), true);  // the connection is as good as before
}

}  // namespace
}  // namespace orbitune::storage_test
