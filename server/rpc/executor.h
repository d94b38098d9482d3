// A few threads for what must not run inside a gRPC reaction: SQL, waiting for a commit, a single episode.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace orbitune {

// Thread-safe.
class Executor {
 public:
  Executor(int threads, std::size_t most_queued);
  Executor(const Executor&) = delete;
  Executor& operator=(const Executor&) = delete;
  ~Executor();  // runs what is queued, then ends

  void Post(std::function<void()> task);

  // False, and the task is dropped, if the queue is full.
  bool TryPost(std::function<void()> task);

 private:
  void Loop();

  const std::size_t most_queued_;

  std::mutex mutex_;
  std::condition_variable ready_;
  // Guarded by mutex_.
  std::deque<std::function<void()>> tasks_;
  bool ending_ = false;

  std::vector<std::thread> threads_;
};

}  // namespace orbitune
