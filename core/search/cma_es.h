// CMA-ES with restarts over ln K, after N. Hansen, "The CMA Evolution Strategy: A Tutorial" (arXiv:1604.00772), whose
// symbols and defaults it keeps, negative weights ("active") included.
#pragma once

#include <vector>

#include "core/search/log_gains.h"
#include "core/search/optimiser.h"

namespace orbitune {

// Iteration 1 is K(1) alone, every other one a generation. A run ends when it has had its share of max_episodes or has
// converged; what it leaves is shared by those after it. A run after the first begins at the best gains so far.
class CmaEs final : public Optimiser {
 public:
  // options valid.
  explicit CmaEs(const SearchOptions& options);

 private:
  using Matrix = Eigen::Matrix<double, kGainCount, kGainCount>;

  void Propose(std::vector<Gains>& batch) override;
  // An error if no gains so far have a cost.
  absl::StatusOr<IterationRecord> Learn(std::span<const EpisodeResult> results) override;
  bool exhausted() const override { return run_ > options().cma_es.restarts; }
  void Save(std::vector<double>& state) const override;
  bool Restore(std::span<const double> state, const IterationRecord& record) override;

  int Population() const;
  void BeginRun(const LogGains& mean, std::int64_t flown);
  void Adapt(std::span<const EpisodeResult> results);
  bool RunIsOver(const IterationRecord& record, std::int64_t flown) const;

  // The state: everything that Save keeps.
  int run_ = 0;               // 0: the first
  int generation_ = 0;        // of the run
  std::int64_t run_end_ = 0;  // episodes after which the run has had its share; 0: no bound
  LogGains mean_;             // m
  double sigma_ = 0;
  Matrix covariance_;          // C
  LogGains path_sigma_;        // p_sigma
  LogGains path_c_;            // p_c
  LogGains best_;              // ln K of the best gains so far
  EpisodeResult best_result_;  // outcome and cost of them

  // Of the present batch, from the state.
  Matrix axes_;                    // B
  LogGains lengths_;               // D
  std::vector<LogGains> samples_;  // x_k = ln K, not yet reflected by the bounds
};

}  // namespace orbitune
