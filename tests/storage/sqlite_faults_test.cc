// The disk failing at each of its calls in turn, while everything that the store can be asked for is done on it: what
// comes out is always what comes out on a good disk.
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <future>
#include <thread>

#include "absl/strings/str_cat.h"
#include "core/scenario/presets.h"
#include "storage/sqlite_store.h"
#include "tests/storage/faulty_disk.h"
#include "tests/storage/sqlite_support.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

using Fault = FaultyDisk::Fault;
using Lasts = FaultyDisk::Lasts;

// What an engineer with a shell of SQLite's own sees of all tables, but for the iterations of deleted jobs, which go
// when there is time.
std::string Dump(const std::string& path) {
  std::string text;
  sqlite3* db = nullptr;
  EXPECT_EQ(sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READONLY, nullptr), SQLITE_OK);
  const auto each_row = [db](const std::string& sql, const std::function<void(sqlite3_stmt*)>& visit) {
    sqlite3_stmt* statement = nullptr;
    EXPECT_EQ(sqlite3_prepare_v2(db, sql.c_str(), -1, &statement, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    int result = SQLITE_DONE;
    while ((result = sqlite3_step(statement)) == SQLITE_ROW) visit(statement);
    EXPECT_EQ(result, SQLITE_DONE) << sqlite3_errmsg(db);
    sqlite3_finalize(statement);
  };
  const auto column = [](sqlite3_stmt* row, int i) {
    const auto* value = reinterpret_cast<const char*>(sqlite3_column_text(row, i));
    return value == nullptr ? "NULL" : std::string(value, static_cast<std::size_t>(sqlite3_column_bytes(row, i)));
  };
  std::vector<std::string> tables;
  each_row("SELECT name FROM sqlite_schema WHERE type = 'table' AND name NOT IN ('deleted_jobs') ORDER BY name",
           [&](sqlite3_stmt* row) { tables.push_back(column(row, 0)); });
  for (const std::string& table : tables) {
    absl::StrAppend(&text, "\n", table, "\n");
    const std::string where = table == "iterations" ? " WHERE job IN (SELECT key FROM jobs)" : "";
    each_row(absl::StrCat("SELECT * FROM ", table, where, " ORDER BY 1, 2"), [&](sqlite3_stmt* row) {
      for (int i = 0; i < sqlite3_column_count(row); ++i) absl::StrAppend(&text, column(row, i), "|");
      absl::StrAppend(&text, "\n");
    });
  }
  each_row("PRAGMA integrity_check", [&](sqlite3_stmt* row) { EXPECT_EQ(column(row, 0), "ok"); });
  sqlite3_close_v2(db);
  return text;
}

NewMember MemberOf(const std::string& campaign, MemberRole role, int number) {
  NewMember member;
  member.member.id = {.role = role, .number = number};
  member.member.initial_condition = FindPreset("leo-rendezvous")->chaser;
  member.member.job_id = absl::StrCat(campaign, number);
  member.job = PlainSpec();
  member.job->campaign_id = campaign;
  return member;
}

// A user of the store who asks again, like a client that retries. Acknowledged is what comes back OK.
class User {
 public:
  User(std::string path, FaultyDisk& disk) : path_(std::move(path)), disk_(disk) {}

  void DoAll() {
    Open();
    CreateJob("tuned", "request-1");
    EXPECT_EQ(CreateJob("tuned-again", "request-1"), "tuned");
    Change("tuned", 2, ChangeTo(JobState::kRunning, 10));
    for (int i = 1; i <= 3; ++i) Append("tuned", 2 + i, i, {.checkpoint = {1.5 * i, 2.5}});
    StateChange succeeded = ChangeTo(JobState::kSucceeded, 20);
    succeeded.report = OddReport();
    succeeded.gain_set = PlainGainSet("tuned");
    Change("tuned", 6, succeeded);
    CreateJob("gone", "");
    Append("gone", 2, 1, {});
    Change("gone", 3, ChangeTo(JobState::kCancelled, 30));
    Ask([this](JobStore::Done done) { store_->DeleteJob("gone", std::move(done)); });
    Ask([this](JobStore::Done done) {
      store_->gains().AddGainSets({OddGainSet("one"), PlainGainSet("two")}, std::move(done));
    });
    Ask([this](JobStore::Done done) { store_->gains().DeleteGainSet("two", std::move(done)); });
    CreateCampaign("kept");
    EndCampaign("kept");
    CreateCampaign("dropped");
    for (const char* job : {"dropped1", "dropped2"}) Change(job, 2, ChangeTo(JobState::kCancelled, 40));
    Ask([this](JobStore::Done done) { store_->campaigns().DeleteCampaign("dropped", std::move(done)); });
    // A crowd in one commit, and what follows a restart.
    for (int i = 1; i < 40; ++i) {
      store_->AppendIteration("kept1", i + 1, RecordOf(i), {}, [](const absl::Status& s) { EXPECT_TRUE(s.ok()) << s; });
    }
    Append("kept1", 41, 40, {});
    store_.reset();
    Open();
    Change("kept1", 42, ChangeTo(JobState::kPaused, 50));
    store_.reset();
  }

 private:
  // Whether it came to an end; else the disk has failed, and is whole again for the next try.
  bool Settled(const absl::Status& status) {
    if (status.ok()) return true;
    EXPECT_TRUE(absl::IsUnavailable(status)) << status;
    EXPECT_TRUE(disk_.struck()) << status;
    disk_.Heal();
    return !absl::IsUnavailable(status);
  }

  void Open() {
    for (bool settled = false; !settled;) {
      auto store = OpenSqliteStore({.path = path_, .first_retry_pause = std::chrono::milliseconds(1)});
      settled = Settled(store.status());
      if (store.ok()) store_ = *std::move(store);
    }
    ASSERT_NE(store_, nullptr);
  }

  // The disk comes back once the store has said that it has failed.
  template <typename Future>
  auto Await(Future answer) {
    while (answer.wait_for(std::chrono::microseconds(200)) != std::future_status::ready) {
      const absl::Status state = store_->ok_for_now();
      if (state.ok()) continue;
      EXPECT_TRUE(absl::IsUnavailable(state)) << state;
      disk_.Heal();
    }
    return answer.get();
  }

  absl::Status Once(const std::function<void(JobStore::Done)>& call) {
    auto answer = std::make_shared<std::promise<absl::Status>>();
    call([answer](absl::Status status) { answer->set_value(std::move(status)); });
    return Await(answer->get_future());
  }

  // NOT_FOUND: an earlier try of a deletion was not acknowledged, and happened all the same.
  void Ask(const std::function<void(JobStore::Done)>& call) {
    absl::Status status = Once(call);
    while (!Settled(status)) status = Once(call);
  }

  // What the engine writes is never refused while the store is open.
  void Must(const std::function<void(JobStore::Done)>& call) {
    const absl::Status status = Once(call);
    EXPECT_TRUE(status.ok()) << status;
  }

  std::string CreateJob(const std::string& id, const std::string& request_id) {
    for (;;) {
      auto answer = std::make_shared<std::promise<absl::StatusOr<JobRecord>>>();
      store_->CreateJob(id, PlainSpec(), 1, request_id, "digest",
                        [answer](absl::StatusOr<JobRecord> record) { answer->set_value(std::move(record)); });
      const absl::StatusOr<JobRecord> record = Await(answer->get_future());
      if (Settled(record.status())) return record.ok() ? record->id : "";
    }
  }

  void CreateCampaign(const std::string& id) {
    for (bool settled = false; !settled;) {
      auto answer = std::make_shared<std::promise<absl::Status>>();
      CampaignSpec spec;
      spec.scenario = *FindPreset("leo-rendezvous");
      store_->campaigns().CreateCampaign(
          {.id = id,
           .spec = spec,
           .members = {MemberOf(id, MemberRole::kTuned, 1), MemberOf(id, MemberRole::kTuned, 2)},
           .time_us = 5,
           .request_id = "request-" + id,
           .request_digest = "digest"},
          [answer](const absl::StatusOr<WrittenCampaign>& written) { answer->set_value(written.status()); });
      settled = Settled(Await(answer->get_future()));
    }
  }

  void EndCampaign(const std::string& id) {
    const MemberEnded ended{.member = {.number = 2}, .job_id = id + "2", .state = JobState::kFailed, .time_us = 7};
    Must([&](JobStore::Done done) { store_->campaigns().AppendMemberEnded(id, 2, ended, std::move(done)); });
    CampaignEnd end;
    end.change = {.state = CampaignState::kSucceeded, .time_us = 9, .message = {}, .results = CampaignResults{}};
    end.evaluated.push_back({.id = {.number = 1}, .initial_condition = {}, .job_id = {}, .episodes = {{}, {}}});
    end.gain_set = PlainGainSet(id);
    Must([&](JobStore::Done done) { store_->campaigns().EndCampaign(id, 3, end, std::move(done)); });
  }

  void Append(const std::string& id, std::int64_t seq, int iteration, Continuation next) {
    Must([&](JobStore::Done done) {
      store_->AppendIteration(id, seq, RecordOf(iteration), std::move(next), std::move(done));
    });
  }
  void Change(const std::string& id, std::int64_t seq, const StateChange& change) {
    Must([&](JobStore::Done done) { store_->ChangeState(id, seq, change, std::move(done)); });
  }

  const std::string path_;
  FaultyDisk& disk_;
  std::unique_ptr<JobStore> store_;
};

// Faults and how long they last; the locks come back by themselves (SQLite waits for them).
std::vector<std::pair<Fault, Lasts>> AllFaults() {
  std::vector<std::pair<Fault, Lasts>> faults = {{Fault::kLocked, Lasts::kOneCall}};
  for (const Fault fault :
       {Fault::kFull, Fault::kWriteError, Fault::kShortWrite, Fault::kSyncError, Fault::kReadOnly}) {
    for (const Lasts lasts : {Lasts::kOneCall, Lasts::kUntilHealed}) faults.emplace_back(fault, lasts);
  }
  return faults;
}

struct Ran {
  bool struck = false;
  std::string dump;  // the database afterwards, on a disk that is whole by then
};

Ran RunWith(const std::function<void(FaultyDisk&)>& harm) {
  // Thousands of commits: in memory, where there is such a place.
  const bool in_memory = access("/dev/shm", W_OK) == 0;
  const TemporaryDirectory directory(in_memory ? "/dev/shm" : std::filesystem::temp_directory_path());
  FaultyDisk disk;
  harm(disk);
  User(directory.File("orbitune.db"), disk).DoAll();
  const bool struck = disk.struck();
  disk.Heal();
  return {.struck = struck, .dump = Dump(directory.File("orbitune.db"))};
}

#if defined(__SANITIZE_THREAD__) || defined(__SANITIZE_ADDRESS__)
constexpr int kStep = 9;  // a sanitizer makes each run ten times as long
#else
constexpr int kStep = 1;
#endif

// Every call fails, by one of the faults in turn; with ORBITUNE_FAULTS=all by every one (minutes).
TEST(SqliteFaults, AtEachCallInTurn) {
  const std::string good = RunWith([](FaultyDisk&) {}).dump;
  const char* all = std::getenv("ORBITUNE_FAULTS");
  const bool each = all != nullptr && std::string(all) == "all";
  const auto faults = AllFaults();
  int failed = 0;
  // Some calls are no place for some faults (a sync cannot be short of room): a run may meet its fault later.
  std::size_t untouched = 0;
  for (int n = 1; untouched < faults.size(); n += kStep) {
    for (std::size_t f = 0; f < (each ? faults.size() : 1); ++f) {
      const auto [fault, lasts] = faults[(static_cast<std::size_t>(n) + f) % faults.size()];
      SCOPED_TRACE(absl::StrCat("call ", n, ", fault ", static_cast<int>(fault), ", lasts ", static_cast<int>(lasts)));
      const Ran ran = RunWith([&, f = fault, l = lasts](FaultyDisk& disk) { disk.SetAt(n, f, l); });
      ASSERT_EQ(ran.dump, good);
      ASSERT_FALSE(testing::Test::HasFailure());
      untouched = ran.struck ? 0 : untouched + 1;
      failed += ran.struck ? 1 : 0;
    }
  }
  std::printf("%d runs met a fault\n", failed);
  EXPECT_GT(failed, 300 / kStep);
}

// Callers wait and are answered; nothing is refused for being slow.
TEST(SqliteFaults, ASlowDiskIsOnlySlow) {
  const std::string good = RunWith([](FaultyDisk&) {}).dump;
  const Ran slow = RunWith([](FaultyDisk& disk) { disk.Set(Fault::kSlow); });
  EXPECT_TRUE(slow.struck);
  EXPECT_EQ(slow.dump, good);
}

}  // namespace
}  // namespace orbitune::storage_test
