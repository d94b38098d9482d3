// Where jobs are kept. Writes are queued, committed in order and in groups by one writer, and answered once they are
// on disk; reads run beside them, blocked by nothing, and see only what is committed.
#pragma once

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "storage/campaign_store.h"
#include "storage/gain_store.h"
#include "storage/job.h"
#include "storage/retention_store.h"

namespace orbitune {

struct JobFilter {
  struct Label {
    std::string key;
    std::string value;
    bool negated = false;  // matches jobs without the key, too
  };
  std::vector<JobState> states;               // any of; empty: every state
  std::vector<JobState> not_states;           // none of
  std::vector<std::string> scenario_ids;      // any of; empty: every one
  std::vector<std::string> not_scenario_ids;  // none of
  std::vector<Label> labels;                  // all of
  std::vector<std::string> texts;             // each somewhere in id, scenario, title or a label, "key=value"
  std::string campaign_id;                    // only this one's jobs; empty: only those that are part of none
};

// Jobs come in a total order: the key, then the id. A page begins behind the last job of the one before.
struct JobQuery {
  enum class Order { kCreateTime, kBestCost };  // jobs without a best cost come last in either direction
  JobFilter filter;
  Order order = Order::kCreateTime;
  bool descending = true;
  int limit = 50;  // > 0
  struct Cursor {
    double key = kUnset;  // create_time_us, or the best cost (NaN: none)
    std::string id;
  };
  std::optional<Cursor> after;
};

// A stretch of a job's iterations, both ends included; beyond the newest there are none.
struct IterationRange {
  int first = 1;
  int last = std::numeric_limits<int>::max();
};

// Thread-safe. Callbacks run on the writer's thread, in the order of the calls, and must not block or call back into
// a write that waits. While the disk fails (`ok_for_now()` tells) what a job or a campaign has done is tried again
// until it succeeds or the store is closed; creations, deletions and gain sets, which somebody can ask for again, are
// answered UNAVAILABLE at once. After UNAVAILABLE only a read, or the next store opened, can tell whether it is on
// disk.
class JobStore {
 public:
  using Done = std::function<void(absl::Status)>;
  // The job created, or the one that an earlier call with the same request id created.
  using Created = std::function<void(absl::StatusOr<JobRecord>)>;

  JobStore() = default;
  JobStore(const JobStore&) = delete;
  JobStore& operator=(const JobStore&) = delete;
  virtual ~JobStore() = default;

  // Stores a job in kQueued, with event 1. id: unused so far. A request_id seen before (empty: none given): the
  // earlier job if request_digest is the same, else ALREADY_EXISTS with reason REQUEST_ID_REUSED. A deleted job's
  // request id is free again.
  virtual void CreateJob(std::string id, JobSpec spec, TimeUs now, std::string request_id, std::string request_digest,
                         Created done) = 0;

  // seq: the job's last one + 1; the record's iteration: its latest + 1. Keeps latest, first and best up to date.
  virtual void AppendIteration(const std::string& id, std::int64_t seq, const IterationRecord& record,
                               Continuation continuation, Done done) = 0;

  // seq: the job's last one + 1. Sets start_time at the first kRunning, end_time at a terminal state. Stores
  // change.gain_set, if there is one, in the same commit.
  virtual void ChangeState(const std::string& id, std::int64_t seq, StateChange change, Done done) = 0;

  // Removes the job, its events and its iterations; not its gain set.
  virtual void DeleteJob(const std::string& id, Done done) = 0;

  // NOT_FOUND if there is none; UNAVAILABLE, DATA_LOSS for a disk that fails (of every read).
  virtual absl::StatusOr<JobRecord> GetJob(const std::string& id) const = 0;

  // Without reports.
  virtual absl::StatusOr<std::vector<JobRecord>> ListJobs(const JobQuery& query) const = 0;

  // In kQueued, kRunning or kPaused, oldest first.
  virtual absl::StatusOr<std::vector<JobRecord>> ListUnfinishedJobs() const = 0;

  // Iterations after `after_iteration`, ascending, at most `limit`. NOT_FOUND for an unknown job; FAILED_PRECONDITION
  // (reason ITERATIONS_REMOVED) where they were removed.
  virtual absl::StatusOr<std::vector<IterationRecord>> ListIterations(const std::string& id, int after_iteration,
                                                                      int limit) const = 0;

  // At most `max_points` (>= 16) of the job's iterations in `range`, ascending: all, where there are no more; else the
  // first, the last, the best, and of equal stretches of the range the iteration of least and that of greatest cost,
  // one without a cost counting as the greatest. NOT_FOUND for an unknown job.
  virtual absl::StatusOr<std::vector<IterationRecord>> SampleIterations(const std::string& id, IterationRange range,
                                                                        int max_points) const = 0;

  // Events after `after_seq`, ascending and dense, at most `limit`; not dense where iterations were removed: those that
  // are left. NOT_FOUND for an unknown job.
  virtual absl::StatusOr<std::vector<JobEvent>> ListEvents(const std::string& id, std::int64_t after_seq,
                                                           int limit) const = 0;

  // Lives as long as the store.
  virtual CampaignStore& campaigns() = 0;
  virtual GainStore& gains() = 0;
  virtual RetentionStore& retention() = 0;

  // Returns once every write queued before the call is committed, or the store is closed.
  virtual void Flush() = 0;

  // OK, or why writes are waiting.
  virtual absl::Status ok_for_now() const = 0;
};

}  // namespace orbitune
