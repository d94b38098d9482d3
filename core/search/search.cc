#include "core/search/search.h"

#include <bit>

namespace orbitune {
namespace {

bool SameBits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b) || (a != a && b != b);
}

int Rank(Outcome outcome) { return outcome == Outcome::kSettled ? 0 : outcome == Outcome::kNotSettled ? 1 : 2; }

template <typename T>
bool BetterOf(const T& a, const T& b) {
  if (Rank(a.outcome) != Rank(b.outcome)) return Rank(a.outcome) < Rank(b.outcome);
  return a.cost < b.cost;
}

}  // namespace

void SetEpisode(const EpisodeResult& result, IterationRecord& record) {
  record.outcome = result.outcome;
  record.cost = result.cost;
  record.settling_samples = result.settling_samples;
  record.fuel_sum = result.fuel_sum;
}

bool Identical(const IterationRecord& a, const IterationRecord& b) {
  for (std::size_t i = 0; i < a.gains.size(); ++i) {
    if (!SameBits(a.gains[i], b.gains[i])) return false;
  }
  return a.iteration == b.iteration && a.outcome == b.outcome && SameBits(a.cost, b.cost) &&
         a.settling_samples == b.settling_samples && SameBits(a.fuel_sum, b.fuel_sum) &&
         SameBits(a.cost_std, b.cost_std) && a.pairs_left_out == b.pairs_left_out &&
         a.pairs_not_settled == b.pairs_not_settled && a.episodes == b.episodes;
}

bool Better(const IterationRecord& a, const IterationRecord& b) { return BetterOf(a, b); }
bool BetterResult(const EpisodeResult& a, const EpisodeResult& b) { return BetterOf(a, b); }

}  // namespace orbitune
