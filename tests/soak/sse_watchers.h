// Watchers over HTTP as text/event-stream: sockets on one thread, opened again where they broke off.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "tests/soak/grpc_watchers.h"
#include "tests/soak/journal.h"

namespace orbitune::soak {

class SseWatchers {
 public:
  // `count` of them, by turns of the jobs. jobs, journal: outlive this.
  SseWatchers(std::string address, int count, std::vector<std::unique_ptr<WatchedJob>>& jobs, Journal& journal);
  ~SseWatchers();

  // The first so many of them stop reading; 0: all read on. The server cuts a stalled one off after a while.
  void Stall(int count) { stalled_ = count; }

  void Stop();

 private:
  struct Watcher;

  void Run();
  void Open(Watcher& watcher);
  void Close(Watcher& watcher);
  void Read(Watcher& watcher);
  void Take(Watcher& watcher, const std::string& event);

  const std::string address_;
  Journal& journal_;
  std::vector<std::unique_ptr<Watcher>> watchers_;
  std::atomic<int> stalled_ = 0;
  int epoll_;
  std::thread thread_;
};

}  // namespace orbitune::soak
