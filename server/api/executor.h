// A few threads for what a transport must not do itself, as it may block: SQL, waiting for a commit, an episode.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "server/jobs/limit.h"

namespace orbitune {

// Clients take turns, and none has all the threads: however much one asks for, others are answered. Thread-safe.
class Executor {
 public:
  struct Limits {
    Limit waiting;             // tasks
    Limit waiting_per_client;  // of them
  };

  // nice: added to the threads' own; what is more than 0 lets others go first.
  Executor(int threads, Limits limits, int nice = 0);
  Executor(const Executor&) = delete;
  Executor& operator=(const Executor&) = delete;
  ~Executor();  // runs what is queued, then ends

  // The server's own: without bounds.
  void Post(std::function<void()> task);

  // RESOURCE_EXHAUSTED with the limit, and the task is dropped, where too many wait. client: not empty.
  absl::Status TryPost(const std::string& client, std::function<void()> task);

  std::size_t waiting();

 private:
  struct Client {
    std::deque<std::function<void()>> tasks;
    int running = 0;
  };
  using Clients = std::map<std::string, Client>;  // the server itself has no name

  void Loop(int nice);
  void Put(Clients::iterator client, std::function<void()> task);
  std::deque<Clients::iterator>::iterator Next();

  const int threads_count_;
  const Limits limits_;

  std::mutex mutex_;
  std::condition_variable ready_;
  // Guarded by mutex_.
  Clients clients_;                      // those with tasks waiting or running
  std::deque<Clients::iterator> turns_;  // of those with tasks waiting
  std::size_t waiting_ = 0;
  bool ending_ = false;

  std::vector<std::thread> threads_;
};

// Watchers let the tuning go first. A few are told at once all the same; a crowd takes what is left of the processors,
// so that a job is hardly slower however many there are.
inline constexpr int kStreamNice = 10;
inline constexpr int kCrowdNice = 19;
// So does whoever wants a job to be run again.
inline constexpr int kVerifyNice = 15;

// What a call keeps busy, and with it how long it may.
enum class Work { kRead, kWrite, kQuery, kEpisode, kStream, kCrowd, kVerify };

struct ExecutorLimits {
  int max_calls_waiting = 4096;             // of each kind of work
  int max_calls_waiting_per_client = 1024;  // of them
  int max_episode_calls = 3;                // at once: SimulateEpisode, QueryGains with a refinement
  int max_verifications = 2;                // at once
};

// Threads by how long their work may block: neither a disk that hangs nor a long episode keeps a read waiting,
// and however many watch, others are answered.
class Executors {
 public:
  explicit Executors(const ExecutorLimits& limits = {});

  Executor& For(Work work);

 private:
  Executor reads_;
  Executor writes_;
  Executor queries_;  // of milliseconds
  Executor episodes_;
  Executor streams_;
  Executor crowd_;          // streams, too, where there are many
  Executor verifications_;  // of minutes, and of less weight than what tunes
};

}  // namespace orbitune
