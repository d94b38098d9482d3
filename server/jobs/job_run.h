// One stretch of a job's execution, from a start or resume to an end or a pause: the search's iterations, then the
// report's episodes, as one batch of episodes after the other. Who flies them, and when, is the scheduler's
// (server/jobs/scheduler.h); that it never shows in a result, this class's.
//
// Of ARS, nothing waits for the episode of K(i) itself but the record. While iterations are quick these episodes are
// put off until there are enough of them to fill a vector: one of them alone would cost the lanes of a whole one.
#pragma once

#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/search/ensemble_search.h"
#include "core/simd/batch_simulator.h"
#include "storage/job_store.h"

namespace orbitune {

// What a batch brought: iterations to be stored, in order, and the error that ends the search, if one does.
struct BatchOutcome {
  struct Iteration {
    IterationRecord record;
    Continuation continuation;
  };
  std::vector<Iteration> iterations;
  absl::Status status;
};

// Calls are one at a time, by the scheduler's lock or because they end a batch, but for Fly, MarkUnwanted and unwanted.
class JobRun {
 public:
  // Of a batch's episodes.
  struct Share {
    std::size_t begin = 0;
    std::size_t count = 0;
  };

  // With its first batch ready. A job that has iterations goes on from its newest, which is run again: it must come
  // out as it is stored. Errors: the scenario's, the search's.
  static absl::StatusOr<std::shared_ptr<JobRun>> Start(const JobRecord& record);

  // What it still flies may be broken off, and comes to nothing.
  void MarkUnwanted() { unwanted_ = true; }
  bool unwanted() const { return unwanted_; }

  bool has_unclaimed() const { return claimed_ < results_.size(); }
  // An equal share of the batch for each of `threads`, so that a single job has all of them; in whole vectors.
  Share Claim(std::size_t threads);
  // What was claimed, and by nobody else.
  BatchUse Fly(Share share);
  // True where nothing of the batch is left to fly.
  bool Finish(Share share);

  // Then, in the search:
  bool searching() const { return search_.has_value(); }
  BatchOutcome FinishSearchBatch();
  // record: with what the batch brought.
  void NextBatch(const JobRecord& record);

  // And of the report's batch, each under K(1), K(M) and the best K from each initial condition:
  const std::vector<PreparedScenario>& prepared() const { return prepared_; }
  const std::vector<EpisodeResult>& results() const { return results_; }
  bool lyapunov_decreasing() const { return lyapunov_decreasing_; }  // under the best

 private:
  explicit JobRun(std::vector<PreparedScenario> prepared) : prepared_(std::move(prepared)) {}

  absl::Status StartSearch(const JobRecord& record);
  BatchEpisode EpisodeAt(std::size_t e) const;
  BatchUse FlyReport(Share share);
  BatchOutcome LearnFromBatch();
  absl::Status CheckReplayed(const IterationRecord& record) const;
  void FlyAtOnce(const Gains& gains, EpisodeResult& result) const;
  std::string DescribeFirst() const;
  bool Unwanted() const { return unwanted_.load(std::memory_order_relaxed); }

  std::atomic<bool> unwanted_ = false;
  const std::vector<PreparedScenario> prepared_;  // of each initial condition
  std::optional<EnsembleSearch> search_;          // none in the report
  std::optional<IterationRecord> replayed_;       // the first iteration must come out as this stored one
  Digest digest_{};                               // of the newest iteration that is complete
  std::optional<Engine> new_engine_;              // to be stored with the next one
  std::vector<Gains> report_gains_;

  // The batch: the search's episodes but the first `put_off_`, then those of `late_`.
  std::vector<EpisodeResult> results_;
  std::size_t searched_ = 0;                      // results before those of `late_`
  std::size_t put_off_ = 0;                       // 0 or 1
  std::vector<BatchOutcome::Iteration> late_;     // all but their own episode, which the batch flies
  std::size_t claimed_ = 0;                       // put_off_ included
  std::size_t finished_ = 0;                      // likewise
  std::atomic<bool> lyapunov_decreasing_ = true;  // under the report's last gains, the best
  std::chrono::steady_clock::time_point begun_;

  std::vector<BatchOutcome::Iteration> incomplete_;  // those of earlier batches that no batch flies yet
  bool updated_ = false;                             // since the start
};

}  // namespace orbitune
