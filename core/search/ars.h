// Augmented Random Search, the paper's Algorithm 1, and its variants (Mania, Guy, Recht 2018): the b best directions,
// schedules for step and exploration, and the logarithm of the gains.
#pragma once

#include <vector>

#include "core/search/optimiser.h"

namespace orbitune {

// delta_j of the paper for one iteration and direction: a function of (seed, iteration, direction) alone.
Gains SearchDirection(const SearchOptions& options, int iteration, int direction);

class ArsSearch final : public Optimiser {
 public:
  // options valid.
  explicit ArsSearch(const SearchOptions& options);

  bool first_is_for_the_record() const override { return options().plateau_stop.iterations == 0; }

 private:
  // 2N + 1 gains: K(i), then K+ and K- of each direction.
  void Propose(std::vector<Gains>& batch) override;
  // An error if every pair had to be left out.
  absl::StatusOr<IterationRecord> Learn(std::span<const EpisodeResult> results) override;
  // K(i) is the record's, and there is nothing more to know.
  void Save(std::vector<double>&) const override {}
  bool Restore(std::span<const double> state, const IterationRecord& record) override;

  // K moved along `direction` by `step` of it, within the bounds.
  Gains Moved(double step, const Gains& direction) const;

  Gains gains_;                    // K(i)
  std::vector<Gains> directions_;  // delta_j
};

}  // namespace orbitune
