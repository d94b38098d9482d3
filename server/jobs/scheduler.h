// Runs jobs: a fixed pool of workers, the state machine of every unfinished job, and the order in which what happens
// to a job reaches the store and, once it is there, the watchers.
//
// A worker takes a chunk of episodes at a time, of the running jobs in turn, so that several jobs share the pool fairly
// and a single one has all of it within an iteration. Who runs an episode, and when, never shows in a result.
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/library/gain_library.h"
#include "server/jobs/event_hub.h"
#include "storage/job_store.h"

namespace orbitune {

TimeUs NowUs();

// A job's version for optimistic locking: changes with each state change.
std::string EtagOf(const JobRecord& record);

// ABORTED (reason ETAG_MISMATCH) unless etag is empty or the record's.
absl::Status CheckEtag(const JobRecord& record, const std::string& etag);

// FAILED_PRECONDITION (reason JOB_STATE) saying that `id` is in `state`, where `action` needs another.
absl::Status WrongState(const std::string& id, JobState state, std::string_view action, std::string_view needed);

// Thread-safe.
class Scheduler {
 public:
  struct Options {
    int threads = 1;            // > 0
    int max_running_jobs = 64;  // the rest waits in order of creation
    // Of one campaign; the rest lets others pass. 0: twice the threads, at least 4.
    int max_running_of_campaign = 0;
    int max_uncommitted_iterations = 256;  // of one job; beyond, it waits for the disk
    GainLibrary* library = nullptr;        // that is told of every gain set, once it is stored; outlives the scheduler
  };
  // The job as of the change, committed.
  using Done = std::function<void(absl::StatusOr<JobRecord>)>;

  // store, hub: outlive this.
  Scheduler(JobStore& store, EventHub& hub, Options options);
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;
  ~Scheduler();  // stops

  // Takes up every unfinished job of the store and starts the workers. Errors: the store's.
  absl::Status Start();

  // Lets the episodes in flight end and starts no more; what was finished is queued at the store. Jobs stay as they
  // are, to be taken up by the next Start of a process.
  void Stop();

  // A job that the store has just created.
  void Add(const JobRecord& created);

  // The transitions a user asks for. etag: empty, or the job's (else ABORTED). NOT_FOUND; FAILED_PRECONDITION where
  // the state does not allow it. `done` is called once, from this call or from the store's writer.
  void Pause(const std::string& id, const std::string& etag, Done done);
  void Resume(const std::string& id, const std::string& etag, Done done);
  void Cancel(const std::string& id, const std::string& etag, Done done);

 private:
  struct Run;  // one stretch of execution, from a start or resume to an end or pause
  struct BatchOutcome;
  struct Entry;  // an unfinished job
  struct Chunk;  // one unit of work
  using EntryPtr = std::shared_ptr<Entry>;
  using Lock = std::unique_lock<std::mutex>;

  void WorkerLoop();
  bool AwaitChunk(Chunk& chunk, Lock& lock);
  void Signal();
  bool NextChunk(Chunk& chunk);
  void FinishBatch(const Chunk& last, Lock& lock);
  void FinishIterations(Entry& entry, Run& run, BatchOutcome outcome);
  void Append(Entry& entry, IterationRecord record, Continuation continuation);
  void FinishReport(Entry& entry, Run& run);
  void StartWaiting();
  void Begin(Entry& entry);
  void RemoveFromRing(const Entry& entry);
  void ChangeState(Entry& entry, StateChange change, Done done);
  void Transition(const std::string& id, const std::string& etag, std::string_view action, std::string_view needed,
                  const std::function<bool(JobState)>& allowed, JobState to, Done done);
  void Committed(const EntryPtr& entry);
  void Refused(const EntryPtr& entry, const absl::Status& status);

  JobStore& store_;
  EventHub& hub_;
  const Options options_;

  std::mutex mutex_;
  std::condition_variable work_;
  // Guarded by mutex_.
  std::map<std::string, EntryPtr> entries_;
  std::deque<EntryPtr> waiting_;  // kQueued, in order
  std::deque<EntryPtr> ring_;     // kRunning; the front is served next
  bool stopping_ = false;
  // Counts signals; written under mutex_ or not, read while waiting for one.
  std::atomic<std::uint64_t> signals_ = 0;

  std::vector<std::thread> workers_;
};

}  // namespace orbitune
