// One watcher of a job: a server stream fed from the hub, and from the store where the watcher lags behind it.
#pragma once

#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <set>

#include "orbitune/v1/tuning.pb.h"
#include "server/rpc/executor.h"
#include "server/service/use_cases.h"

namespace orbitune {

class Watcher;

// The watchers of a server, so that a drain can end them. Thread-safe.
class Watchers {
 public:
  // Ends every watcher with UNAVAILABLE, and every later one at once.
  void Drain();

 private:
  friend class Watcher;
  bool Add(const std::shared_ptr<Watcher>& watcher);  // false once drained
  void Remove(const std::shared_ptr<Watcher>& watcher);

  std::mutex mutex_;
  std::set<std::shared_ptr<Watcher>> watchers_;
  bool drained_ = false;
};

// The reactor of one WatchJob call; lives until the call is done. use_cases, executor, watchers: outlive it.
grpc::ServerWriteReactor<v1::WatchJobResponse>* StartWatch(const v1::WatchJobRequest& request, UseCases& use_cases,
                                                           Executor& executor, Watchers& watchers);

}  // namespace orbitune
