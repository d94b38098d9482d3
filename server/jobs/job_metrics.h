// What the job engine counts, for whoever shows it. Written in passing, read at any time.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

#include "core/base/histogram.h"
#include "storage/job.h"

namespace orbitune {

struct JobMetrics {
  std::atomic<std::int64_t> iterations = 0;                      // committed
  std::atomic<std::int64_t> episodes = 0;                        // flown
  std::atomic<std::int64_t> lane_steps = 0;                      // of the kernel, in all its lanes
  std::atomic<std::int64_t> used_lane_steps = 0;                 // in those that had an episode to fly
  std::array<std::atomic<std::int64_t>, 6> ended{};              // by JobState, committed; of the terminal ones
  Histogram queue_wait_s{Histogram::Exponential(0.001, 4, 12)};  // from QUEUED to RUNNING; up to 70 minutes
};

// Unfinished jobs at a moment.
struct JobCounts {
  int queued = 0;
  int running = 0;
  int paused = 0;
};

}  // namespace orbitune
