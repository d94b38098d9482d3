// The one writer: a thread that has the writing connection to itself, takes what is queued, runs it in one transaction,
// commits, and only then answers. While the disk fails it tries again; nothing is answered OK that is not on disk.
//
// A commit costs a flush of the disk and, with the kernel's part, more processor time than what is in it. So where
// operations come in numbers that nobody waits for one by one, they are gathered for some milliseconds.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "storage/sqlite_job_tables.h"
#include "storage/store_metrics.h"

namespace orbitune {

// Thread-safe. The queue is as long as its callers let it grow.
class SqliteWriter {
 public:
  struct Operation {
    // OK, or why it is refused, with nothing written. Runs in the group's transaction; again after a rollback.
    std::function<absl::Status(JobTables&)> apply;
    // Called once, on the writer's thread, in the order of the queue: with the result of apply once that is committed;
    // UNAVAILABLE where the writer ends before that, or INTERNAL or DATA_LOSS where SQLite refuses this operation.
    // The writer keeps no part of the status: its reference counts are in a library that TSan cannot see into.
    std::function<void(absl::Status)> answer;
    // Somebody waits who can ask again: while the disk fails it is not tried again, but answered UNAVAILABLE at once,
    // ahead of what was queued before it.
    bool refusable = false;
    // It may be gathered with others.
    bool can_wait = false;
  };

  // connection outlives this and is used by nobody else meanwhile. first_pause: before a failed commit is tried again;
  // the pauses after it grow to 2 s. metrics, if there are any, outlive it too.
  SqliteWriter(Connection& connection, std::chrono::milliseconds first_pause, StoreMetrics* metrics = nullptr);

  // Commits what is queued, if the disk lets it at the first try, answers everything and ends the thread.
  ~SqliteWriter();
  SqliteWriter(const SqliteWriter&) = delete;
  SqliteWriter& operator=(const SqliteWriter&) = delete;

  void Queue(Operation operation);

  // Returns once everything queued before the call is answered. Not from an answer.
  void Flush();

  // OK, or why what is queued waits.
  absl::Status trouble() const;

 private:
  void Run();
  // Waits until what is queued is worth a commit, or does not wait for others. mutex_ held.
  void Gather(std::unique_lock<std::mutex>& lock);
  // Waits for work; false: the writer ends, and nothing is queued. Empty: nothing is queued, but leftovers are there.
  bool TakeGroup(std::vector<Operation>& group);
  // One result for each operation; one that was refused meanwhile has no answer any more.
  std::vector<absl::Status> Commit(std::span<Operation> group);
  // An error of SQLite's: nothing is committed. Else the operations' own results, committed.
  absl::StatusOr<std::vector<absl::Status>> TryCommit(std::span<const Operation> group);
  // So that only the operations that SQLite refuses are answered with its error.
  std::vector<absl::Status> CommitOneByOne(std::span<Operation> group);
  // Answers what need not wait for the disk, in the group and in the queue.
  void Refuse(std::span<Operation> group);
  void Count(std::size_t operations, std::chrono::duration<double> taken);
  void CountAnswered(std::size_t answered);
  void RemoveLeftovers();
  bool stopping() const;
  void SetTrouble(std::string reason);
  void PauseBeforeRetry(std::chrono::milliseconds pause);

  // Writer thread only.
  Connection& connection_;
  JobTables tables_;
  const std::chrono::milliseconds first_pause_;
  StoreMetrics* const metrics_;
  bool leftovers_ = true;       // perhaps
  bool leftovers_hit_ = false;  // by an error, and had better wait
  bool gave_up_ = false;        // the disk failed while the writer was ending
  std::size_t last_group_ = 0;  // its size
  std::chrono::steady_clock::time_point last_taken_;

  mutable std::mutex mutex_;
  std::condition_variable work_;      // queue_ or stopping_ changed
  std::condition_variable answered_;  // answered_count_ changed
  // Guarded by mutex_.
  std::deque<Operation> queue_;
  std::uint64_t queued_count_ = 0;
  std::uint64_t answered_count_ = 0;
  bool pressing_ = false;  // something that is queued cannot wait
  bool stopping_ = false;
  std::string trouble_;  // why what is queued waits; empty: it does not

  std::thread thread_;  // last: it uses all of the above
};

}  // namespace orbitune
