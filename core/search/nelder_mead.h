// The simplex method of Nelder and Mead over ln K, with the parameters for five dimensions of Gao and Han (2012),
// flown in batches: reflection, expansion and both contractions at once, of which its rules then take one.
#pragma once

#include <array>
#include <vector>

#include "core/search/log_gains.h"
#include "core/search/optimiser.h"

namespace orbitune {

// Iteration 1 is K(1) alone, the next the other five corners. A simplex that has shrunk to a point, or whose corners
// cost as good as the same, makes place for one of the first size about its best corner.
class NelderMead final : public Optimiser {
 public:
  // options valid.
  explicit NelderMead(const SearchOptions& options);

 private:
  enum class Phase { kFirst, kCorners, kStep, kShrink };
  struct Corner {
    LogGains x;
    EpisodeResult result;  // outcome and cost alone
  };

  void Propose(std::vector<Gains>& batch) override;
  // An error if no gains so far have a cost.
  absl::StatusOr<IterationRecord> Learn(std::span<const EpisodeResult> results) override;
  bool exhausted() const override { return run_ > options().nelder_mead.restarts; }
  void Save(std::vector<double>& state) const override;
  bool Restore(std::span<const double> state, const IterationRecord& record) override;

  void Step(std::span<const EpisodeResult> results);
  void ReplaceOthers(std::span<const EpisodeResult> results);
  void Sort();
  bool HasConverged() const;

  // The state.
  Phase phase_ = Phase::kFirst;
  int run_ = 0;                                 // 0: the first simplex
  std::array<Corner, kGainCount + 1> corners_;  // the best first

  std::vector<LogGains> samples_;  // of the present batch, within the bounds
};

}  // namespace orbitune
