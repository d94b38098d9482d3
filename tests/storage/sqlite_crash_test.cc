// kill -9 at any moment: all that was answered is there afterwards, dense and with every bit.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
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

// Runs the child for a while, kills it, and returns the last seq that it was answered for each job.
std::array<std::int64_t, kJobs> RunAndKill(const std::string& path, std::chrono::microseconds lifetime) {
  int ends[2];
  EXPECT_EQ(pipe(ends), 0);
  const pid_t child = fork();
  if (child == 0) RunChild(path, ends[1]);
  close(ends[1]);
  std::array<std::int64_t, kJobs> last{};
  Told told{};
  const auto note = [&] { last[static_cast<std::size_t>(told.job)] = told.seq; };
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

}  // namespace
}  // namespace orbitune::storage_test
