// What goes from the store by age or size, for a policy (server/jobs/retention.h) to choose from. Gain sets and what
// has not ended are not among it.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "storage/job.h"

namespace orbitune {

// Thread-safe; callbacks, waits and errors as JobStore's.
class RetentionStore {
 public:
  using Done = std::function<void(absl::Status)>;

  RetentionStore() = default;
  RetentionStore(const RetentionStore&) = delete;
  RetentionStore& operator=(const RetentionStore&) = delete;
  virtual ~RetentionStore() = default;

  struct Ended {
    std::string id;
    TimeUs end_time_us = 0;
  };

  // Each: what ended before that time, what ended first first, at most `limit`.
  // Jobs of no campaign.
  virtual absl::StatusOr<std::vector<Ended>> JobsEndedBefore(TimeUs time_us, int limit) const = 0;
  virtual absl::StatusOr<std::vector<Ended>> CampaignsEndedBefore(TimeUs time_us, int limit) const = 0;
  // Jobs whose iterations are there to be removed: of no campaign, or of one that has ended too (then by its time).
  virtual absl::StatusOr<std::vector<Ended>> HistoriesEndedBefore(TimeUs time_us, int limit) const = 0;

  // Removes a job's iterations but the first, the best and the last, from every read at once, and from the disk a few
  // at a time. NOT_FOUND; FAILED_PRECONDITION unless the job has ended.
  virtual void RemoveIterations(const std::string& job_id, TimeUs now, Done done) = 0;

  struct Usage {
    std::int64_t bytes = 0;  // of the database that hold something; what was removed leaves room, not a smaller file
    bool removing = false;   // something removed is still to be taken from the disk
  };
  virtual absl::StatusOr<Usage> GetUsage() const = 0;
};

}  // namespace orbitune
