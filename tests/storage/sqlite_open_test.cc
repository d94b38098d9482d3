// Opening: one server at a time, schema versions, damage, directories that will not do.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <random>
#include <set>
#include <sstream>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "storage/serialise.h"
#include "storage/sqlite_schema.h"
#include "storage/sqlite_store.h"
#include "tests/storage/sqlite_support.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

class SqliteOpen : public testing::Test {
 protected:
  std::string Database() const { return directory_.File("orbitune.db"); }
  void Execute(const std::string& script) {
    auto connection = Connection::Open(Database(), Connection::Mode::kReadWrite);
    ASSERT_TRUE(connection.ok()) << connection.status();
    const absl::Status status = (*connection)->Execute(script);
    ASSERT_TRUE(status.ok()) << status;
  }
  void MakeDatabase(int iterations = 10) { CreateWithIterations(*OpenStore(Database()), "a", iterations); }

  TemporaryDirectory directory_;
};

void ExpectMessage(const absl::Status& status, absl::StatusCode code, const std::string& path,
                   const std::string& words) {
  EXPECT_EQ(status.code(), code) << status;
  EXPECT_TRUE(absl::StrContains(status.message(), path)) << status;
  EXPECT_TRUE(absl::StrContains(status.message(), words)) << status;
}

TEST_F(SqliteOpen, RefusesASecondServer) {
  const auto store = OpenStore(Database());
  const auto owner = absl::StrCat("process ", getpid());
  ExpectMessage(OpenError(Database()), absl::StatusCode::kFailedPrecondition, directory_.File("orbitune.lock"), owner);
  // By another way to the same directory, too.
  std::filesystem::create_directory_symlink(directory_.path(), directory_.path() / "link");
  ExpectMessage(OpenError(directory_.File("link/orbitune.db")), absl::StatusCode::kFailedPrecondition,
                directory_.File("orbitune.lock"), owner);
  EXPECT_TRUE(Create(*store, "a").ok());
}

TEST_F(SqliteOpen, IsFreeAgainOnceClosed) {
  OpenStore(Database()).reset();
  EXPECT_NE(OpenStore(Database()), nullptr);
}

TEST_F(SqliteOpen, LeavesOneFileAndTheLockBehind) {
  auto store = OpenStore(Database());
  CreateWithIterations(*store, "a", 10);
  EXPECT_TRUE(store->GetJob("a").ok());
  EXPECT_TRUE(std::filesystem::exists(directory_.File("orbitune.db-wal")));
  store.reset();
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(directory_.path()))
    names.insert(entry.path().filename());
  EXPECT_EQ(names, (std::set<std::string>{"orbitune.db", "orbitune.lock"}));
}

// version1.sql was made by the server that had that version.
TEST_F(SqliteOpen, ReadsTheJobsOfVersion1) {
  std::ostringstream script;
  script << std::ifstream(absl::StrCat(ORBITUNE_STORAGE_TESTS, "/version1.sql")).rdbuf();
  Execute(script.str());
  const auto store = OpenStore(Database());
  const auto finished = store->GetJob("finished");
  ASSERT_TRUE(finished.ok()) << finished.status();
  EXPECT_EQ(finished->state, JobState::kSucceeded);
  EXPECT_EQ(finished->spec.labels.at("team"), "orbit");
  EXPECT_EQ(finished->spec.scenario.search.seed, 3u);
  EXPECT_EQ(finished->spec.scenario.search.algorithm, Algorithm::kArs);
  EXPECT_EQ(finished->report->episodes, 6 * 5);
  EXPECT_EQ(finished->latest->cost, 757.3293669434922);
  const auto history = store->ListIterations("finished", 0, 100);
  ASSERT_TRUE(history.ok()) << history.status();
  for (const IterationRecord& record : *history) EXPECT_EQ(record.episodes, 5 * record.iteration);
  EXPECT_EQ(store->ListEvents("finished", 0, 100)->size(), 9u);
  EXPECT_EQ(store->GetJob("failed")->state, JobState::kFailed);
  const auto unfinished = store->ListUnfinishedJobs();
  ASSERT_EQ(unfinished->size(), 1u);
  EXPECT_EQ(unfinished->at(0).id, "paused");
  EXPECT_EQ(unfinished->at(0).best->episodes, 4 * 7);
  // The same request is the same job still.
  JobSpec same = finished->spec;
  const auto again = Create(*store, "other", same, 1, "11111111-0000-4000-8000-000000000001", *ToJson(same));
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ(again->id, "finished");
  ASSERT_TRUE(Append(*store, "paused", 8, RecordOf(5)).ok());
}

TEST_F(SqliteOpen, RefusesANewerSchemaAndLeavesItAlone) {
  MakeDatabase();
  const auto newer = static_cast<std::int64_t>(Migrations().size()) + 1;
  Execute(absl::StrCat("PRAGMA user_version = ", newer));
  const std::string before = FileContents(Database());
  const absl::Status status = OpenError(Database());
  ExpectMessage(status, absl::StatusCode::kFailedPrecondition, Database(), absl::StrCat("version ", newer));
  ExpectMessage(status, absl::StatusCode::kFailedPrecondition, Database(), absl::StrCat("up to ", newer - 1));
  EXPECT_EQ(FileContents(Database()), before);
}

TEST_F(SqliteOpen, RefusesAnotherProgramsDatabaseAndLeavesItAlone) {
  Execute("CREATE TABLE theirs (x);");
  const std::string before = FileContents(Database());
  ExpectMessage(OpenError(Database()), absl::StatusCode::kFailedPrecondition, Database(), "another program");
  EXPECT_EQ(FileContents(Database()), before);
}

TEST_F(SqliteOpen, MigratesStepByStepAndKeepsTheData) {
  MakeDatabase();
  auto connection = Connection::Open(Database(), Connection::Mode::kReadWrite);
  ASSERT_TRUE(connection.ok()) << connection.status();
  std::vector<std::string_view> migrations(Migrations().begin(), Migrations().end());
  const auto first = static_cast<std::int64_t>(migrations.size());
  migrations.push_back("ALTER TABLE jobs ADD COLUMN note TEXT; UPDATE jobs SET note = id || '!'");
  migrations.push_back("CREATE TABLE extra (x INTEGER) STRICT; INSERT INTO extra SELECT count(*) FROM iterations");
  ASSERT_TRUE(Migrate(**connection, migrations).ok());
  EXPECT_EQ(QueryInt(Database(), "PRAGMA user_version"), first + 2);
  EXPECT_EQ(QueryInt(Database(), "SELECT x FROM extra"), 10);
  EXPECT_EQ(QueryInt(Database(), "SELECT count(*) FROM jobs WHERE note = 'a!'"), 1);
  // Nothing is left to do.
  EXPECT_TRUE(Migrate(**connection, migrations).ok());
  EXPECT_EQ(QueryInt(Database(), "SELECT count(*) FROM extra"), 1);
  // An older server refuses it.
  EXPECT_TRUE(absl::IsFailedPrecondition(OpenError(Database())));
}

TEST_F(SqliteOpen, AFailingMigrationLeavesTheLastVersionThatWasReached) {
  MakeDatabase();
  auto connection = Connection::Open(Database(), Connection::Mode::kReadWrite);
  ASSERT_TRUE(connection.ok()) << connection.status();
  std::vector<std::string_view> migrations(Migrations().begin(), Migrations().end());
  const auto first = static_cast<std::int64_t>(migrations.size());
  migrations.push_back("CREATE TABLE good (x)");
  migrations.push_back("CREATE TABLE half (x); INSERT INTO no_such_table VALUES (1)");
  const absl::Status status = Migrate(**connection, migrations);
  ExpectMessage(status, absl::StatusCode::kInternal, Database(), "no_such_table");
  ExpectMessage(status, absl::StatusCode::kInternal, Database(),
                absl::StrCat("version ", first + 1, " to ", first + 2));
  EXPECT_EQ(QueryInt(Database(), "PRAGMA user_version"), first + 1);
  EXPECT_EQ(QueryInt(Database(), "SELECT count(*) FROM sqlite_schema WHERE name = 'good'"), 1);
  EXPECT_EQ(QueryInt(Database(), "SELECT count(*) FROM sqlite_schema WHERE name = 'half'"), 0);
}

TEST_F(SqliteOpen, SaysThatAFileIsNoDatabase) {
  SetFileContents(Database(), std::string(8192, 'x'));
  ExpectMessage(OpenError(Database()), absl::StatusCode::kDataLoss, Database(), "not a database");
}

TEST_F(SqliteOpen, SaysThatAHeaderIsDamaged) {
  MakeDatabase();
  std::string contents = FileContents(Database());
  contents.replace(0, 100, 100, '\0');
  SetFileContents(Database(), contents);
  ExpectMessage(OpenError(Database()), absl::StatusCode::kDataLoss, Database(), "not a database");
}

TEST_F(SqliteOpen, SaysThatAFileIsCutOff) {
  MakeDatabase(1000);
  const std::string contents = FileContents(Database());
  for (const std::size_t size : {contents.size() / 2, contents.size() - 4096, std::size_t{4096}, std::size_t{1000}}) {
    SetFileContents(Database(), contents.substr(0, size));
    const absl::Status status = OpenError(Database());
    EXPECT_TRUE(absl::IsDataLoss(status)) << size << ": " << status;
    EXPECT_TRUE(absl::StrContains(status.message(), Database())) << status;
  }
}

// Anything may have been overwritten: what cannot be read is an error, never a crash.
TEST_F(SqliteOpen, SurvivesDamageAnywhere) {
  MakeDatabase(600);
  {
    std::vector<GainSet> sets;
    for (int i = 0; i < 20; ++i) sets.push_back(PlainGainSet(absl::StrCat("set", i)));
    ASSERT_TRUE(AddGainSets(*OpenStore(Database()), sets).ok());
  }
  const std::string whole = FileContents(Database());
  std::mt19937 random(5);
  int errors = 0;
  for (int round = 0; round < 60; ++round) {
    std::string contents = whole;
    const std::size_t begin = 100 + random() % (contents.size() - 700);
    for (std::size_t i = 0; i < 600; ++i) contents[begin + i] = static_cast<char>(random());
    SetFileContents(Database(), contents);
    auto store = OpenSqliteStore({.path = Database()});
    if (!store.ok()) {
      ++errors;
      continue;
    }
    errors += (*store)->GetJob("a").ok() ? 0 : 1;
    errors += (*store)->ListJobs({}).ok() ? 0 : 1;
    errors += (*store)->ListEvents("a", 0, 1000).ok() ? 0 : 1;
    errors += (*store)->gains().ListGainSets({}).ok() ? 0 : 1;
    errors += (*store)->gains().ReadLibrary([](const auto&, const auto&, const auto&) {}).ok() ? 0 : 1;
    errors += Append(**store, "a", 602, RecordOf(601)).ok() ? 0 : 1;
    (void)Delete(**store, "a");
    (void)Create(**store, "b");
  }
  EXPECT_GT(errors, 20);
}

TEST_F(SqliteOpen, NamesTheDirectoryThatWillNotDo) {
  ExpectMessage(OpenError(directory_.File("none/orbitune.db")), absl::StatusCode::kNotFound, directory_.File("none"),
                "");
  SetFileContents(directory_.File("file"), "");
  ExpectMessage(OpenError(directory_.File("file/orbitune.db")), absl::StatusCode::kFailedPrecondition,
                directory_.File("file"), "not a directory");
  ExpectMessage(OpenError(directory_.path().string()), absl::StatusCode::kFailedPrecondition,
                directory_.path().string(), "is a directory");
}

// As a user who is not root: root may write everywhere.
absl::StatusCode OpenAsNobody(const std::string& path) {
  const pid_t child = fork();
  if (child == 0) {
    if (geteuid() == 0 && (setegid(65534) != 0 || seteuid(65534) != 0)) _exit(255);
    _exit(static_cast<int>(OpenError(path).code()));
  }
  int status = 0;
  waitpid(child, &status, 0);
  return static_cast<absl::StatusCode>(WEXITSTATUS(status));
}

TEST_F(SqliteOpen, SaysThatNothingCanBeWritten) {
  MakeDatabase();
  ASSERT_EQ(chmod(directory_.path().c_str(), 0555), 0);
  ASSERT_EQ(chmod(directory_.File("orbitune.lock").c_str(), 0444), 0);
  EXPECT_EQ(OpenAsNobody(Database()), absl::StatusCode::kPermissionDenied);  // the lock file
  ASSERT_EQ(chmod(directory_.path().c_str(), 0777), 0);
  ASSERT_EQ(chmod(directory_.File("orbitune.lock").c_str(), 0666), 0);
  ASSERT_EQ(chmod(Database().c_str(), 0444), 0);
  EXPECT_EQ(OpenAsNobody(Database()), absl::StatusCode::kPermissionDenied);  // the database
  ASSERT_EQ(chmod(Database().c_str(), 0666), 0);
  EXPECT_EQ(OpenAsNobody(Database()), absl::StatusCode::kOk);
}

TEST_F(SqliteOpen, SaysThatAnotherProcessLocksTheFile) {
  MakeDatabase();
  auto other = Connection::Open(Database(), Connection::Mode::kReadWrite);
  ASSERT_TRUE(other.ok());
  ASSERT_TRUE((*other)->Execute("PRAGMA locking_mode = EXCLUSIVE; BEGIN IMMEDIATE; UPDATE jobs SET id = id;").ok());
  ExpectMessage(OpenError(Database()), absl::StatusCode::kUnavailable, Database(), "locked");
}

}  // namespace
}  // namespace orbitune::storage_test
