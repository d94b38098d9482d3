// kill -9 at any moment: all that was answered is there afterwards, dense and with every bit.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <thread>

#include "absl/strings/str_cat.h"
#include "storage/sqlite_store.h"
#include "tests/storage/sqlite_support.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

constexpr int kJobs = 3;

std::string JobId(int j) { return absl::StrCat("job-", j); }

// What the child tells of one answer; short enough that a pipe takes it whole.
struct Told {
  int job;
  std::int64_t seq;
};

// Every fifth event is a change of state, the others are iterations.
bool IsChange(std::int64_t seq) { return seq == 1 || seq % 5 == 0; }
JobState StateAt(std::int64_t seq) { return seq % 10 == 0 ? JobState::kPaused : JobState::kRunning; }
int IterationAt(std::int64_t seq) { return static_cast<int>(seq - 1 - seq / 5); }

void Write(JobStore& store, int job, std::int64_t seq, int pipe) {
  const auto done = [job, seq, pipe](const absl::Status& status) {
    const Told told{.job = job, .seq = seq};
    if (!status.ok() || write(pipe, &told, sizeof told) != sizeof told) _exit(1);
  };
  if (IsChange(seq)) {
    store.ChangeState(JobId(job), seq, ChangeTo(StateAt(seq), seq), done);
  } else {
    store.AppendIteration(JobId(job), seq, RecordOf(IterationAt(seq)), {}, done);
  }
}

// Writes for ever, from where each job stands.
[[noreturn]] void RunChild(const std::string& path, int pipe) {
  auto store = OpenSqliteStore({.path = path});
  if (!store.ok()) _exit(2);
  std::array<std::int64_t, kJobs> next{};
  for (int j = 0; j < kJobs; ++j) {
    const auto job = (*store)->GetJob(JobId(j));
    if (!job.ok() && !Create(**store, JobId(j)).ok()) _exit(3);
    next[static_cast<std::size_t>(j)] = job.ok() ? job->last_seq + 1 : 2;
  }
  for (;;) {
    for (int i = 0; i < 50; ++i) {
      for (int j = 0; j < kJobs; ++j) Write(**store, j, next[static_cast<std::size_t>(j)]++, pipe);
    }
    std::this_thread::sleep_for(std::chrono::microseconds(300));
  }
}

// Runs the child for a while, kills it, and returns the last that it told; all goes to `tell` as well.
Told RunAndKill(const std::function<void(int pipe)>& run_child, std::chrono::microseconds lifetime,
                const std::function<void(const Told&)>& tell) {
  int ends[2];
  EXPECT_EQ(pipe(ends), 0);
  const pid_t child = fork();
  if (child == 0) run_child(ends[1]);
  close(ends[1]);
  Told told{.job = -1, .seq = 0};
  const auto note = [&] { tell(told); };
  // A pipe that nobody empties would stop the child.
  if (read(ends[0], &told, sizeof told) == sizeof told) note();
  std::thread killer([&] {
    std::this_thread::sleep_for(lifetime);
    kill(child, SIGKILL);
  });
  while (read(ends[0], &told, sizeof told) == sizeof told) note();
  killer.join();
  close(ends[0]);
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFSIGNALED(status)) << "the child ended by itself with " << WEXITSTATUS(status);
  return told;
}

// The last seq that the child was answered for each job.
std::array<std::int64_t, kJobs> RunAndKill(const std::string& path, std::chrono::microseconds lifetime) {
  std::array<std::int64_t, kJobs> last{};
  RunAndKill([&](int pipe) { RunChild(path, pipe); }, lifetime,
             [&](const Told& told) { last[static_cast<std::size_t>(told.job)] = told.seq; });
  return last;
}

void CheckHistory(JobStore& store, int j, std::int64_t answered) {
  const auto job = store.GetJob(JobId(j));
  ASSERT_TRUE(job.ok()) << job.status();
  ASSERT_GE(job->last_seq, answered);
  const auto events = store.ListEvents(JobId(j), 0, 1'000'000'000);
  ASSERT_TRUE(events.ok()) << events.status();
  ASSERT_EQ(static_cast<std::int64_t>(events->size()), job->last_seq);
  for (std::int64_t seq = 1; seq <= job->last_seq; ++seq) {
    const JobEvent& event = (*events)[static_cast<std::size_t>(seq - 1)];
    ASSERT_EQ(event.seq, seq);
    if (!IsChange(seq)) {
      ASSERT_TRUE(Identical(std::get<IterationRecord>(event.what), RecordOf(IterationAt(seq)))) << seq;
    } else if (seq > 1) {
      ASSERT_EQ(std::get<StateChange>(event.what).state, StateAt(seq));
      ASSERT_EQ(std::get<StateChange>(event.what).time_us, seq);
    }
  }
}

TEST(SqliteCrash, KeepsAllThatWasAnswered) {
  const TemporaryDirectory directory;
  const std::string path = directory.File("orbitune.db");
  std::int64_t total = 0;
  for (int round = 0; round < 8; ++round) {
    const auto answered = RunAndKill(path, std::chrono::microseconds(20'000 + 13'700 * round));
    const auto store = OpenStore(path);  // the lock went with the process
    ASSERT_NE(store, nullptr);
    for (int j = 0; j < kJobs; ++j) CheckHistory(*store, j, answered[static_cast<std::size_t>(j)]);
    if (answered[0] > 0) {
      EXPECT_GT(answered[0], total);
      total = answered[0];
    }
  }
  EXPECT_GT(total, 100);
}

// Creates jobs and lets them succeed, for ever.
[[noreturn]] void RunSucceedingChild(const std::string& path, int pipe, int first) {
  auto store = OpenSqliteStore({.path = path});
  if (!store.ok()) _exit(2);
  for (int j = first;; ++j) {
    const std::string id = JobId(j);
    if (!Create(**store, id).ok()) _exit(3);
    (*store)->ChangeState(id, 2, ChangeTo(JobState::kRunning), [](const absl::Status&) {});
    (*store)->AppendIteration(id, 3, RecordOf(1), {}, [](const absl::Status&) {});
    StateChange succeeded = ChangeTo(JobState::kSucceeded);
    succeeded.gain_set = PlainGainSet(id);
    (*store)->ChangeState(id, 4, succeeded, [j, pipe](const absl::Status& status) {
      const Told told{.job = j, .seq = 4};
      if (!status.ok() || write(pipe, &told, sizeof told) != sizeof told) _exit(1);
    });
  }
}

// Whenever the process ends: a job that has succeeded has its gain set, and no other job has one.
TEST(SqliteCrash, AJobAndItsGainSetEndTogether) {
  const TemporaryDirectory directory;
  const std::string path = directory.File("orbitune.db");
  int jobs = 0;
  int succeeded = 0;
  for (int round = 0; round < 6; ++round) {
    const Told last = RunAndKill([&](int pipe) { RunSucceedingChild(path, pipe, jobs); },
                                 std::chrono::microseconds(15'000 + 11'300 * round), [](const Told&) {});
    const auto store = OpenStore(path);
    ASSERT_NE(store, nullptr);
    for (; store->GetJob(JobId(jobs)).ok(); ++jobs) {
      const bool ended = store->GetJob(JobId(jobs))->state == JobState::kSucceeded;
      const auto set = store->gains().GetGainSet(JobId(jobs));
      ASSERT_EQ(set.ok(), ended) << jobs;
      ASSERT_TRUE(ended || jobs > last.job) << jobs << " was answered";
      succeeded += ended ? 1 : 0;
    }
  }
  EXPECT_GT(succeeded, 10);
}

}  // namespace
}  // namespace orbitune::storage_test
