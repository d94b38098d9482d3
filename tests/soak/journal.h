// What the soak's clients saw: faults, each with what was wrong; latencies, and counts.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace orbitune::soak {

using Clock = std::chrono::steady_clock;

// Times in buckets 2 % apart. Thread-safe.
class Latencies {
 public:
  void Note(double seconds);
  std::int64_t count() const;
  // In milliseconds; p in (0, 1].
  double Percentile_ms(double p) const;
  void Clear();

 private:
  std::array<std::atomic<std::int64_t>, 1200> buckets_{};
};

// When an event of a job reached the first watcher of all: how much later it reaches another one is how far that one
// is behind. Thread-safe.
class FirstSeen {
 public:
  // Seconds since the first one saw it; 0: this is the first one, or nobody knows any more.
  double Note(std::int64_t seq, Clock::time_point now);

 private:
  struct Slot {
    std::atomic<std::int64_t> seq = 0;
    std::atomic<std::int64_t> at_ns = 0;
  };
  std::array<Slot, 1 << 14> slots_;
};

struct Journal {
  // Something that must not be. The first few are kept in words.
  void Fault(const std::string& what);
  // A refusal that the documentation knows: RESOURCE_EXHAUSTED, or UNAVAILABLE while the server restarts.
  void Refusal() { ++refusals; }

  std::vector<std::string> faults();

  std::atomic<bool> stopping = false;    // clients end
  std::atomic<bool> restarting = false;  // connections may break
  std::atomic<std::int64_t> fault_count = 0;
  std::atomic<std::int64_t> refusals = 0;
  std::atomic<std::int64_t> grpc_events = 0;
  std::atomic<std::int64_t> sse_events = 0;
  std::atomic<std::int64_t> jobs_ended = 0;
  std::atomic<std::int64_t> calls = 0;
  std::atomic<std::int64_t> cut_off = 0;  // stalled SSE watchers that the server let go of, as it says it does
  Latencies call_time;                    // of unary calls
  Latencies behind_first;                 // of watchers that read

 private:
  std::mutex mutex_;
  std::vector<std::string> faults_;  // guarded by mutex_
};

// The order in which a watcher must see a job: every event once (EVERY), or what is skipped told by gaps (LATEST).
class SequenceCheck {
 public:
  explicit SequenceCheck(std::string who) : who_(std::move(who)) {}

  // first: of a gap, else seq.
  void Take(std::int64_t first, std::int64_t seq, Journal& journal);
  std::int64_t last() const { return last_; }

 private:
  std::string who_;
  std::int64_t last_ = 0;
};

}  // namespace orbitune::soak
