// Runs jobs: a fixed pool of workers, the state machine of every unfinished job, and the order in which what happens
// to a job reaches the store and, once it is there, the watchers.
//
// A worker takes a chunk of episodes at a time: of the client that has had least of the workers' time so far, and of
// its jobs of the one that has had least for its priority. So clients share the pool equally, however many jobs each
// has, and a single job has all of it within an iteration. Who runs an episode, and when, never shows in a result.
//
// Jobs that wait begin one by one as others end: of the client with the fewest running, its job of the highest priority
// and of those the oldest; every eighth time its oldest of all, so that none waits for ever. A client that has none
// running does not wait for others' jobs to end: up to twice as many as may run at a time may then run.
//
// A client is a job's owner, or where it has none the address that it came from.
#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/base/clock.h"
#include "core/library/gain_library.h"
#include "core/simd/batch_simulator.h"
#include "server/jobs/event_hub.h"
#include "server/jobs/job_metrics.h"
#include "storage/job_store.h"

namespace orbitune {

class JobRun;
struct BatchOutcome;

// Whose a job or a campaign is, where clients are to have equal shares: the owner's, else whoever's is at the address.
template <typename Spec>
const std::string& ClientOf(const Spec& spec) {
  return spec.owner.empty() ? spec.peer : spec.owner;
}

// A job's version for optimistic locking: changes with each state change.
std::string EtagOf(const JobRecord& record);

// ABORTED (reason ETAG_MISMATCH) unless etag is empty or the record's.
absl::Status CheckEtag(const JobRecord& record, const std::string& etag);

// FAILED_PRECONDITION (reason JOB_STATE) saying that `id` is in `state`, where `action` needs another.
absl::Status WrongState(const std::string& id, JobState state, std::string_view action, std::string_view needed);

// What unfinished jobs may come to. No client may have more than half of what all together may.
struct JobLimits {
  int max_queued_jobs = 100'000;
  int max_jobs_per_client = 1000;                   // unfinished, and part of no campaign
  std::int64_t max_job_memory_bytes = 256LL << 20;  // of the unfinished jobs' specs, about
};

// Thread-safe.
class Scheduler {
 public:
  struct Options {
    int threads = 1;            // > 0
    int max_running_jobs = 64;  // the rest waits
    JobLimits limits;
    // Of one campaign; the rest lets others pass. 0: twice the threads, at least 4.
    int max_running_of_campaign = 0;
    int max_uncommitted_iterations = 512;  // of one job; beyond, it waits for the disk
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

  // Breaks off the episodes in flight and starts no more; what was finished is queued at the store. Jobs stay as they
  // are, to be taken up by the next Start of a process.
  void Stop();

  // Room for jobs that are about to be created, held until the object goes.
  class Room {
   public:
    Room(Room&& other) noexcept { *this = std::move(other); }
    Room& operator=(Room&& other) noexcept;
    ~Room();

   private:
    friend class Scheduler;
    Room() = default;
    Scheduler* scheduler_ = nullptr;
    std::string client_;
    int jobs_ = 0;
    int of_no_campaign_ = 0;
    std::int64_t bytes_ = 0;
  };
  // For so many jobs like this one. RESOURCE_EXHAUSTED with the limit (server/jobs/limit.h) where there is none.
  absl::StatusOr<Room> Reserve(const JobSpec& spec, int jobs);

  // A job that the store has just created.
  void Add(const JobRecord& created);

  // The transitions a user asks for. etag: empty, or the job's (else ABORTED). NOT_FOUND; FAILED_PRECONDITION where
  // the state does not allow it. `done` is called once, from this call or from the store's writer.
  void Pause(const std::string& id, const std::string& etag, Done done);
  void Resume(const std::string& id, const std::string& etag, Done done);
  void Cancel(const std::string& id, const std::string& etag, Done done);

  const JobMetrics& metrics() const { return metrics_; }
  JobCounts counts();

 private:
  struct Entry;  // an unfinished job
  struct Client;
  struct Chunk;  // one unit of work
  using EntryPtr = std::shared_ptr<Entry>;
  using ClientPtr = std::shared_ptr<Client>;
  using Lock = std::unique_lock<std::mutex>;

  void WorkerLoop();
  bool AwaitChunk(Chunk& chunk, Lock& lock);
  void Signal();
  bool NextChunk(Chunk& chunk);
  static void Charge(Entry& entry, double steps);
  static void Account(const Chunk& chunk, const BatchUse& use);
  void FinishBatch(const Chunk& last, Lock& lock);
  void FinishIterations(Entry& entry, JobRun& run, BatchOutcome outcome);
  void Append(Entry& entry, IterationRecord record, Continuation continuation);
  void FinishReport(Entry& entry, JobRun& run);
  EntryPtr AddEntry(JobRecord record);
  void Forget(EntryPtr entry);
  void Count(Client& client, int jobs, int of_no_campaign, std::int64_t bytes);
  void PutIntoQueue(const EntryPtr& entry);
  EntryPtr TakeFromQueue();
  void StartWaiting();
  void Begin(Entry& entry);
  void Halt(Entry& entry);
  void DropRun(Entry& entry);
  void Fail(Entry& entry, const absl::Status& status);
  void ChangeState(Entry& entry, StateChange change, Done done);
  void Transition(const std::string& id, const std::string& etag, std::string_view action, std::string_view needed,
                  const std::function<bool(JobState)>& allowed, JobState to, Done done);
  void Committed(const EntryPtr& entry);
  void Refused(const EntryPtr& entry, const absl::Status& status);

  JobStore& store_;
  EventHub& hub_;
  const Options options_;
  JobMetrics metrics_;

  std::mutex mutex_;
  std::condition_variable work_;
  // Guarded by mutex_.
  std::map<std::string, EntryPtr> entries_;
  std::map<std::string, ClientPtr> clients_;  // those that have jobs, or room for some
  int queued_ = 0;                            // jobs, and room for them
  int running_ = 0;                           // of all clients
  std::array<int, 6> by_state_{};             // entries
  std::int64_t job_bytes_ = 0;                // of all entries' specs, and of room for them
  std::uint64_t next_order_ = 0;              // of waiting
  std::uint64_t begun_ = 0;                   // jobs so far
  double served_ = 0;                         // what the client served last had had
  bool stopping_ = false;
  // Counts signals; written under mutex_, read while waiting for one.
  std::atomic<std::uint64_t> signals_ = 0;

  std::vector<std::thread> workers_;
};

}  // namespace orbitune
