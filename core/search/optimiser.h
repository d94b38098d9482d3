// A search over gains as a machine that asks for a batch of episodes and takes their results: whoever drives it decides
// where the episodes run, and may stop between any two iterations and go on elsewhere. What all algorithms share: when
// they end, what they count, and the checkpoint.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/search/options.h"
#include "core/search/search.h"

namespace orbitune {

// Not thread-safe. Driven as: while (!search.done()) { evaluate(search.batch(), results); search.Update(results); }
// Everything it does is a function of its options and the results.
class Optimiser {
 public:
  virtual ~Optimiser() = default;
  Optimiser(const Optimiser&) = delete;
  Optimiser& operator=(const Optimiser&) = delete;

  // After M iterations, where the next batch would pass max_episodes, on a plateau, or where the algorithm has ended.
  // Never before the first iteration.
  bool done() const;
  int iteration() const { return iteration_; }

  // Gains to simulate, each in [gain_floor, kMaxGain]; the first one of iteration 1 is K(1). Valid until Update.
  std::span<const Gains> batch() const { return batch_; }

  // True if the first of batch() is flown for the record only: nothing that the search does later depends on its
  // result, which may come late (a caller then completes the record by SetEpisode).
  virtual bool first_is_for_the_record() const { return false; }

  // results[j] belongs to batch()[j]. Moves on to the next iteration and returns this one's record;
  // FAILED_PRECONDITION if there is no cost to learn from, with the search where it was.
  absl::StatusOr<IterationRecord> Update(std::span<const EpisodeResult> results);

  // What a search needs, beside the record of iteration(), to take up at the start of iteration(); empty for the
  // paper's ARS, for which the record is enough.
  std::vector<double> checkpoint() const;

  // To where iteration `last` began, from its record and the checkpoint before it: the same batch, and Update then
  // returns a record identical to `last`. DATA_LOSS if the checkpoint is not one of such a search; then it must not be
  // used.
  absl::Status Resume(const IterationRecord& last, std::span<const double> checkpoint);

 protected:
  // options valid.
  explicit Optimiser(const SearchOptions& options) : options_(options) {}
  // To be called at the end of the constructor.
  void Begin() { Propose(batch_); }

  // Learns from the results of the batch; the record's iteration and episodes are filled in by the caller. An error
  // must leave everything as it was.
  virtual absl::StatusOr<IterationRecord> Learn(std::span<const EpisodeResult> results) = 0;
  // The batch of iteration(): a function of it and the state. `batch`: whatever it was, replaced.
  virtual void Propose(std::vector<Gains>& batch) = 0;
  // The algorithm has nothing left to do.
  virtual bool exhausted() const { return false; }
  // The state before the batch, appended; and back, given the record of the batch. False: that is no such state.
  virtual void Save(std::vector<double>& state) const = 0;
  virtual bool Restore(std::span<const double> state, const IterationRecord& record) = 0;

  const SearchOptions& options() const { return options_; }
  // Flown before the batch.
  std::int64_t episodes() const { return episodes_; }

 private:
  void WatchPlateau(const IterationRecord& record);

  const SearchOptions options_;
  int iteration_ = 1;
  std::int64_t episodes_ = 0;
  // The plateau: the cost that counts as the best, and the iteration that brought it.
  double level_cost_ = kUnset;
  int level_iteration_ = 0;
  std::vector<Gains> batch_;
};

// The search that the options choose; options valid.
std::unique_ptr<Optimiser> MakeOptimiser(const SearchOptions& options);

// Runs a search to its end, or to the first error (INVALID_ARGUMENT for the options); `observe` sees every record in
// order.
absl::Status RunSearch(const SearchOptions& options, const Evaluate& evaluate,
                       const std::function<void(const IterationRecord&)>& observe);

// The record of a batch of candidates: the best of them, the earliest of equals, and the others as its "pairs".
IterationRecord RecordOfCandidates(std::span<const Gains> batch, std::span<const EpisodeResult> results);

}  // namespace orbitune
