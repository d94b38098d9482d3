// The events of one job: a snapshot, then every one after a seq, from the hub, and from the store where the watcher
// lags behind it.
#pragma once

#include <deque>
#include <map>
#include <unordered_map>

#include "orbitune/v1/tuning.pb.h"
#include "server/api/executor.h"
#include "server/api/feed.h"
#include "server/service/use_cases.h"

namespace orbitune {

// Recent events as messages, in runs, so that each is read, made and written out once for all the watchers of its job.
// Thread-safe.
class JobEventMessages {
 public:
  explicit JobEventMessages(std::size_t most_kept = 8192) : most_kept_(most_kept) {}

  // What is kept of the events that follow `after_seq`, dense, at most `limit`. There may be more than these.
  std::vector<StreamPart> After(const std::string& job_id, std::int64_t after_seq, std::size_t limit) const;

  // The messages of these events, which are dense, made where they are not kept.
  std::vector<StreamPart> Of(const std::string& job_id, const std::vector<EventHub::Event>& events);

 private:
  using Runs = std::map<std::int64_t, std::shared_ptr<const StreamRun>>;  // by the seq of the first

  // What is kept from `seq` on, without a break; at most `limit`.
  static std::optional<StreamPart> From(const Runs& runs, std::int64_t seq, std::size_t limit);
  void ForgetOldest();

  const std::size_t most_kept_;

  mutable std::mutex mutex_;
  // Guarded by mutex_.
  std::unordered_map<std::string, Runs> jobs_;
  std::deque<std::pair<std::string, std::int64_t>> kept_;  // runs, oldest first
  std::size_t kept_messages_ = 0;
};

// What feeds of jobs share; all outlive them.
struct JobFeedContext {
  UseCases& use_cases;
  Executors& executors;
  JobEventMessages& messages;
  Feeds& feeds;
};

std::shared_ptr<Feed> NewJobFeed(const v1::WatchJobRequest& request, const JobFeedContext& context);

}  // namespace orbitune
