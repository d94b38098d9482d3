// Augmented Random Search, the paper's Algorithm 1, as a machine that asks for a batch of episodes and takes their
// results: whoever drives it decides where the episodes run, and may stop between any two iterations.
#pragma once

#include <cstdint>
#include <vector>

#include "core/search/search.h"

namespace orbitune {

struct ArsOptions {
  int iterations = 2000;            // M
  double step_size = 5e-3;          // alpha
  double exploration_scale = 2e-3;  // sigma
  int directions = 16;              // N
  Gains initial_gains{0.1, 1, 1, 1, 10};
  Gains exploration_std{1, 1, 1, 1, 1};  // of delta_j, one value per gain: sqrt(diag(Sigma_delta))
  double gain_floor = 1e-3;              // every gain simulated is at least this
  std::uint64_t seed = 1;

  static constexpr int kMaxIterations = 10'000'000;
  static constexpr int kMaxDirections = 1024;
  static constexpr double kMaxGain = 1e6;

  // OK, or INVALID_ARGUMENT with every field that is out of range.
  absl::Status Validate() const;
};

// delta_j of the paper for one iteration and direction: a function of (seed, iteration, direction) alone.
Gains SearchDirection(const ArsOptions& options, int iteration, int direction);

// Not thread-safe. Driven as: while (!search.done()) { evaluate(search.batch(), results); search.Update(results); }
class ArsSearch {
 public:
  // options valid.
  explicit ArsSearch(const ArsOptions& options);

  // Takes up after a crash or a pause: `last` is the newest record kept. Its iteration is evaluated again, for K of
  // the next one follows from its results; Update then returns a record identical to `last`.
  ArsSearch(const ArsOptions& options, const IterationRecord& last);

  bool done() const { return iteration_ > options_.iterations; }
  int iteration() const { return iteration_; }

  // 2N + 1 gains to simulate: K(i), then K+ and K- of each direction. Valid until Update.
  std::span<const Gains> batch() const { return batch_; }

  // results[j] belongs to batch()[j]. Moves on to the next iteration and returns this one's record;
  // FAILED_PRECONDITION if every pair had to be left out, with the search where it was.
  absl::StatusOr<IterationRecord> Update(std::span<const EpisodeResult> results);

 private:
  void FillBatch();

  ArsOptions options_;
  int iteration_;
  Gains gains_;                    // K(i)
  std::vector<Gains> directions_;  // delta_j
  std::vector<Gains> batch_;
};

// Runs a search to its end, or to the first error; `observe` sees every record in order.
absl::Status RunArs(const ArsOptions& options, const Evaluate& evaluate,
                    const std::function<void(const IterationRecord&)>& observe);

}  // namespace orbitune
