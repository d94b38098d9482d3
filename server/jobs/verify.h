// Whether a job's history is what its inputs give, and what was recorded: the stored iterations are chained again and
// compared with the stored digest, then run again and compared bit for bit.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "storage/job_store.h"

namespace orbitune {

enum class Verdict {
  kIdentical,  // and the digest, where there is one, is that of the iterations stored
  kDifferent,  // the digest is, but run again an iteration differs
  kAltered,    // inputs or iterations are not those of which the digest was made
};

// Iterations, from 1. 0: the first, the newest.
struct VerifyRange {
  int first = 0;
  int last = 0;
};

struct VerifyProgress {
  int first_iteration = 0;  // of those that are run again
  int last_iteration = 0;
  int iteration = 0;  // the newest that was; 0 while the stored ones are chained
};

struct Verification {
  struct Difference {
    int iteration = 0;
    std::optional<IterationRecord> stored;      // none: the search goes on where the history ends
    std::optional<IterationRecord> recomputed;  // none: the search ends before
  };

  Verdict verdict = Verdict::kIdentical;
  int completed_iterations = 0;  // of the job when it was read; all of them are chained
  int first_iteration = 0;       // that was run again: the range's, or as far before it as the search has to start
  int last_iteration = 0;
  std::optional<Difference> first_difference;
  Digest digest{};  // of the stored iterations; of those run again where retention removed the stored ones
  std::optional<Digest> recorded_digest;        // stored with them; none: the job ended under a server that kept none
  std::vector<std::string> engine_differences;  // between what ran the job and what ran it now, where bits may differ
  std::string conclusion;                       // for people
};

// Called between batches, some milliseconds apart where initial conditions are few; false: enough.
using VerifyObserver = std::function<bool(const VerifyProgress&)>;

// Reads the store page by page, and runs the episodes on the calling thread. A search that can be taken up at any
// iteration (ARS, unless its end or its objective depends on earlier ones) starts at the one before the range, to reach
// the first K of it; any other at iteration 1. NOT_FOUND; INVALID_ARGUMENT for first_iteration, last_iteration;
// FAILED_PRECONDITION (JOB_STATE) where the job has no iteration yet, (ITERATIONS_REMOVED) for a stretch of what
// retention removed; CANCELLED where the observer had enough; the store's.
absl::StatusOr<Verification> VerifyJob(const JobStore& store, const std::string& job_id, VerifyRange range,
                                       const VerifyObserver& observe);

}  // namespace orbitune
