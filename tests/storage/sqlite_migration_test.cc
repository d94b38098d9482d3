// Databases of every earlier schema version, as their servers left them: what they hold is read back as it was.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <sstream>
#include <thread>

#include "absl/strings/str_cat.h"
#include "storage/serialise.h"
#include "storage/sqlite_backup.h"
#include "storage/sqlite_schema.h"
#include "storage/sqlite_store.h"
#include "tests/storage/faulty_disk.h"
#include "tests/storage/sqlite_support.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

void Load(int version, const std::string& path) {
  std::ostringstream script;
  script << std::ifstream(absl::StrCat(ORBITUNE_STORAGE_TESTS, "/version", version, ".sql")).rdbuf();
  auto connection = Connection::Open(path, Connection::Mode::kReadWrite);
  ASSERT_TRUE(connection.ok()) << connection.status();
  const absl::Status status = (*connection)->Execute(script.str());
  ASSERT_TRUE(status.ok()) << status;
}

// Versions 2 and later were made with the same jobs.
class SqliteMigration : public testing::TestWithParam<int> {
 protected:
  void SetUp() override { Load(GetParam(), Database()); }
  std::string Database() const { return directory_.File("orbitune.db"); }
  // Of the job that was labelled so; empty: there is none.
  static std::string IdOf(const JobStore& store, const std::string& name) {
    JobQuery query;
    query.filter.labels.push_back({.key = "case", .value = name});
    const auto jobs = store.ListJobs(query);
    EXPECT_TRUE(jobs.ok()) << jobs.status();
    return jobs->empty() ? "" : jobs->front().id;
  }

  TemporaryDirectory directory_;
};

TEST_P(SqliteMigration, KeepsEveryJob) {
  const auto store = OpenStore(Database());
  const std::vector<std::tuple<std::string, JobState, int>> jobs = {
      {"finished", JobState::kSucceeded, 6}, {"finished-cma", JobState::kSucceeded, 3},
      {"failed", JobState::kFailed, 0},      {"cancelled", JobState::kCancelled, 2},
      {"paused", JobState::kPaused, 3},      {"paused-ars", JobState::kPaused, 3},
      {"running", JobState::kRunning, 2},    {"running-cma", JobState::kRunning, 2}};
  for (const auto& [name, state, at_least] : jobs) {
    SCOPED_TRACE(name);
    const std::string id = IdOf(*store, name);
    const auto job = store->GetJob(id);
    ASSERT_TRUE(job.ok()) << job.status();
    EXPECT_EQ(job->state, state);
    EXPECT_EQ(job->spec.labels.at("team"), "orbit");
    EXPECT_GE(job->completed_iterations(), at_least);
    EXPECT_EQ(job->last_seq, job->completed_iterations() + job->state_changes);
    const auto events = store->ListEvents(id, 0, 1000);
    ASSERT_TRUE(events.ok()) << events.status();
    EXPECT_EQ(static_cast<std::int64_t>(events->size()), job->last_seq);
    EXPECT_EQ(job->report.has_value(), state == JobState::kSucceeded);
    EXPECT_EQ(job->iterations_removed_us, 0);
    // The same request is the same job still.
    const auto again = Create(*store, "new", job->spec, 1, "request-" + name, *ToJson(job->spec));
    ASSERT_TRUE(again.ok()) << again.status();
    EXPECT_EQ(again->id, id);
    if (!IsTerminal(state)) {
      ASSERT_TRUE(Append(*store, id, job->last_seq + 1, RecordOf(job->completed_iterations() + 1)).ok());
    }
  }
  for (const char* name : {"paused", "running-cma"}) {
    EXPECT_FALSE(store->GetJob(IdOf(*store, name))->checkpoint.empty()) << name;
  }
  EXPECT_EQ(IdOf(*store, "deleted"), "");
  EXPECT_EQ(store->GetJob(IdOf(*store, "finished"))->latest->episodes, 30);
}

TEST_P(SqliteMigration, KeepsGainSetsAndCampaigns) {
  const auto store = OpenStore(Database());
  EXPECT_EQ(store->gains().GetGainSet(IdOf(*store, "finished")).ok(), GetParam() >= 3);
  const auto campaigns = store->campaigns().ListCampaigns({});
  ASSERT_TRUE(campaigns.ok()) << campaigns.status();
  ASSERT_THAT(*campaigns, SizeIs(GetParam() >= 4 ? 2 : 0));
  for (const CampaignRecord& campaign : *campaigns) {
    const auto members = store->campaigns().ListMembers(campaign.id, {}, 100);
    ASSERT_TRUE(members.ok()) << members.status();
    EXPECT_THAT(*members, SizeIs(4));
    const auto events = store->campaigns().ListCampaignEvents(campaign.id, 0, 100);
    ASSERT_TRUE(events.ok()) << events.status();
    EXPECT_EQ(static_cast<std::int64_t>(events->size()), campaign.last_seq);
    const bool finished = campaign.spec.display_name == "the finished campaign";
    EXPECT_EQ(campaign.state, finished ? CampaignState::kSucceeded : CampaignState::kRunning);
    EXPECT_EQ(store->campaigns().GetCampaign(campaign.id)->results.has_value(), finished);
  }
}

TEST_P(SqliteMigration, IsSoundAndHasABackupBeside) {
  OpenStore(Database()).reset();
  const auto backups = MigrationBackupsBeside(Database());
  ASSERT_THAT(backups, SizeIs(1));
  EXPECT_THAT(backups[0], HasSubstr(absl::StrCat("orbitune-schema", GetParam(), "-")));
  for (const std::string& path : {Database(), backups[0]}) {
    auto connection = Connection::Open(path, Connection::Mode::kReadOnly);
    ASSERT_TRUE(connection.ok()) << connection.status();
    const auto faults = FindFaults(**connection);
    ASSERT_TRUE(faults.ok()) << faults.status();
    EXPECT_THAT(*faults, SizeIs(0)) << path;
  }
  EXPECT_EQ(QueryInt(backups[0], "PRAGMA user_version"), GetParam());
  EXPECT_EQ(QueryInt(Database(), "PRAGMA user_version"), static_cast<std::int64_t>(Migrations().size()));
  // What was deleted goes at last, while the store has nothing else to do.
  auto store = OpenStore(Database());
  for (int i = 0; i < 6000 && QueryInt(Database(), "SELECT count(*) FROM deleted_jobs") > 0; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  store.reset();
  EXPECT_EQ(QueryInt(Database(), "SELECT count(*) FROM iterations WHERE job NOT IN (SELECT key FROM jobs)"), 0);
  // Nothing is left to do, and so there is no second backup.
  EXPECT_THAT(MigrationBackupsBeside(Database()), SizeIs(1));
}

INSTANTIATE_TEST_SUITE_P(Version, SqliteMigration, testing::Values(2, 3, 4));

TEST(SqliteMigrationBackup, WithoutOneNothingIsMigrated) {
  const TemporaryDirectory directory;
  const std::string path = directory.File("orbitune.db");
  Load(4, path);
  const std::string before = FileContents(path);
  {
    FaultyDisk disk;
    disk.Set(FaultyDisk::Fault::kFull);
    const absl::Status status = OpenError(path);
    EXPECT_TRUE(absl::IsUnavailable(status)) << status;
    for (const char* words : {"schema version 4", "not changed", "backup"}) {
      EXPECT_THAT(std::string(status.message()), HasSubstr(words));
    }
  }
  EXPECT_EQ(FileContents(path), before);
  EXPECT_THAT(MigrationBackupsBeside(path), SizeIs(0));
  EXPECT_EQ(OpenStore(path)->ListJobs({})->size(), 8u);
}

}  // namespace
}  // namespace orbitune::storage_test
