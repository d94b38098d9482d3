// Removes what is old, or too much, by a policy that an operator has set; in the background, a little at a time. Gain
// sets and what has not ended always stay.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "server/jobs/campaign_engine.h"
#include "storage/job_store.h"

namespace orbitune {

// All off by default. Days count from the end of a job or campaign; 0: kept for ever.
struct RetentionPolicy {
  double jobs_days = 0;        // those of no campaign, with all that is theirs
  double campaigns_days = 0;   // with their jobs
  double iterations_days = 0;  // of every job (a campaign's: from its end) all but the first, the best and the last
  double backups_days = 0;     // that the server made before migrations; the newest one stays
  // Where more is in use, iterations go first, then jobs and campaigns, what ended first first. 0: no limit.
  std::int64_t max_database_bytes = 0;

  bool off() const {
    return jobs_days == 0 && campaigns_days == 0 && iterations_days == 0 && backups_days == 0 &&
           max_database_bytes == 0;
  }
};

class Retention {
 public:
  // Is told what was removed, and what could not be, a line each; from any thread.
  using Log = std::function<void(const std::string&)>;

  // store, campaigns: outlive this. database: the file that backups lie beside.
  Retention(JobStore& store, CampaignEngine& campaigns, std::string database, const RetentionPolicy& policy, Log log);
  Retention(const Retention&) = delete;
  Retention& operator=(const Retention&) = delete;
  ~Retention() { Stop(); }

  // Passes at once and every minute, on a thread of its own. Nothing where the policy is off.
  void Start();
  // Ends a pass under way behind what it is removing.
  void Stop();

  // One pass. Not beside Start's.
  void Pass(TimeUs now);

 private:
  using Ended = RetentionStore::Ended;
  using List = std::function<absl::StatusOr<std::vector<Ended>>(int limit)>;
  using Remove = std::function<absl::Status(const std::string& id)>;

  absl::Status RemoveByAge(TimeUs now);
  absl::Status RemoveAll(const std::string& what, const List& list, const Remove& remove);
  // How many went; names them to the log.
  absl::StatusOr<int> RemoveSome(const std::string& what, const List& list, const Remove& remove, int limit);
  absl::Status RemoveBySize();
  absl::StatusOr<int> RemoveOldest();
  void RemoveBackups(TimeUs now);
  absl::Status RemoveJob(const std::string& id);
  absl::Status RemoveIterations(const std::string& id);
  bool WaitOrStop(std::chrono::milliseconds time);  // true: stopping
  bool stopping();

  JobStore& store_;
  CampaignEngine& campaigns_;
  const std::string database_;
  const RetentionPolicy policy_;
  const Log log_;
  bool told_that_full_ = false;

  std::mutex mutex_;
  std::condition_variable stop_;
  bool stopping_ = false;  // guarded by mutex_
  std::thread thread_;
};

}  // namespace orbitune
