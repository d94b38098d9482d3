// A few threads for what a transport must not do itself, as it may block: SQL, waiting for a commit, an episode.
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
  // nice: added to the threads' own; what is more than 0 lets others go first.
  Executor(int threads, std::size_t most_queued, int nice = 0);
  Executor(const Executor&) = delete;
  Executor& operator=(const Executor&) = delete;
  ~Executor();  // runs what is queued, then ends

  void Post(std::function<void()> task);

  // False, and the task is dropped, if the queue is full.
  bool TryPost(std::function<void()> task);

 private:
  void Loop(int nice);

  const std::size_t most_queued_;

  std::mutex mutex_;
  std::condition_variable ready_;
  // Guarded by mutex_.
  std::deque<std::function<void()>> tasks_;
  bool ending_ = false;

  std::vector<std::thread> threads_;
};

// Watchers take what the tuning leaves of the processors: however many there are, a job is hardly slower.
inline constexpr int kStreamNice = 10;
// So does whoever wants a job to be run again.
inline constexpr int kVerifyNice = 15;

// Of the thread that calls. Where the system refuses, it stays as it was.
void AddNice(int nice);

// What a call keeps busy, and with it how long it may.
enum class Work { kRead, kWrite, kQuery, kEpisode, kStream, kVerify };

// Threads by how long their work may block: neither a disk that hangs nor a long episode keeps a read waiting,
// and however many watch, others are answered.
class Executors {
 public:
  Executor& For(Work work);

 private:
  Executor reads_{4, 10'000};
  Executor writes_{4, 10'000};
  Executor queries_{2, 1'000};  // of milliseconds
  Executor episodes_{2, 256};
  Executor streams_{2, 10'000, kStreamNice};
  Executor verifications_{2, 16, kVerifyNice};  // of minutes
};

}  // namespace orbitune
