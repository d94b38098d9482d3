// Watchers over gRPC: each a stream that is opened again where it broke off.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tests/soak/journal.h"

namespace orbitune::soak {

struct WatchedJob {
  std::string name;
  FirstSeen first_seen;
};

class GrpcWatchers {
 public:
  // `count` of them, over a channel for each fifty, by turns of the jobs; every other one takes every event, a third of
  // them in batches, the others the latest. jobs, journal: outlive this.
  GrpcWatchers(const std::string& address, int count, std::vector<std::unique_ptr<WatchedJob>>& jobs, Journal& journal);
  ~GrpcWatchers();

  // The first so many of them stop reading, without ending; again: they read on.
  void Stall(int count);
  void GoOn();

  // Waits until all have ended; to be called once journal.stopping is set.
  void Stop();

 private:
  class Watcher;
  std::vector<std::shared_ptr<Watcher>> watchers_;
};

}  // namespace orbitune::soak
