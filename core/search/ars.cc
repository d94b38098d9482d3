#include "core/search/ars.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/base/random.h"

namespace orbitune {
namespace {

// A direction whose two episodes have a cost.
struct Pair {
  const EpisodeResult* plus;
  const EpisodeResult* minus;
  const Gains* direction;
};

std::vector<Pair> UsablePairs(std::span<const EpisodeResult> results, const std::vector<Gains>& directions) {
  std::vector<Pair> pairs;
  for (std::size_t j = 0; j < directions.size(); ++j) {
    const EpisodeResult& plus = results[1 + 2 * j];
    const EpisodeResult& minus = results[2 + 2 * j];
    if (HasCost(plus.outcome) && HasCost(minus.outcome)) pairs.push_back({&plus, &minus, &directions[j]});
  }
  return pairs;
}

// The b with the least min(J+, J-), the earlier of equals, in the order they were in.
void KeepTop(std::vector<Pair>& pairs, std::size_t b) {
  if (b == 0 || b >= pairs.size()) return;
  const auto least = [](const Pair& p) { return std::min(p.plus->cost, p.minus->cost); };
  std::vector<Pair> ranked = pairs;
  std::ranges::stable_sort(ranked, {}, least);
  ranked.resize(b);
  std::erase_if(pairs, [&](const Pair& p) {
    return std::ranges::none_of(ranked, [&](const Pair& kept) { return kept.plus == p.plus; });
  });
}

struct PairStatistics {
  double cost_std = 0;  // sigma_J
  Gains ascent{};       // sum over the pairs of (J+ - J-) delta_j
};

PairStatistics Summarise(const std::vector<Pair>& pairs) {
  PairStatistics statistics;
  double sum = 0;
  for (const Pair& p : pairs) {
    sum += p.plus->cost;
    sum += p.minus->cost;
    for (std::size_t i = 0; i < kGainCount; ++i) {
      statistics.ascent[i] += (p.plus->cost - p.minus->cost) * (*p.direction)[i];
    }
  }
  const auto n = static_cast<double>(2 * pairs.size());
  const double mean = sum / n;
  double squares = 0;
  for (const Pair& p : pairs) {
    squares += (p.plus->cost - mean) * (p.plus->cost - mean);
    squares += (p.minus->cost - mean) * (p.minus->cost - mean);
  }
  statistics.cost_std = std::sqrt(squares / n);
  return statistics;
}

double Factor(Schedule schedule, int iteration, int iterations) {
  switch (schedule) {
    case Schedule::kConstant:
      break;
    case Schedule::kLinear:
      return 1 - static_cast<double>(iteration - 1) / iterations;
    case Schedule::kInverseSqrt:
      return 1 / std::sqrt(static_cast<double>(iteration));
  }
  return 1;
}

}  // namespace

Gains SearchDirection(const SearchOptions& options, int iteration, int direction) {
  const RandomKey key{.seed = options.seed,
                      .stream = RandomStream::kSearchDirections,
                      .a = static_cast<std::uint32_t>(iteration),
                      .b = static_cast<std::uint32_t>(direction)};
  Gains delta;
  for (std::uint32_t i = 0; i < kGainCount; ++i) delta[i] = options.exploration_std[i] * StandardNormal(key, i);
  return delta;
}

ArsSearch::ArsSearch(const SearchOptions& options) : Optimiser(options), gains_(options.initial_gains) { Begin(); }

bool ArsSearch::Restore(std::span<const double> state, const IterationRecord& record) {
  gains_ = record.gains;
  return state.empty();
}

Gains ArsSearch::Moved(double step, const Gains& direction) const {
  Gains k = gains_;
  for (std::size_t i = 0; i < kGainCount; ++i) {
    if (options().ars_variants.log_gains) {
      k[i] *= std::exp(step * direction[i] / options().initial_gains[i]);
    } else {
      k[i] += step * direction[i];
    }
  }
  return WithinBounds(options(), k);
}

void ArsSearch::Propose(std::vector<Gains>& batch) {
  const double scale = options().exploration_scale *
                       Factor(options().ars_variants.exploration_schedule, iteration(), options().iterations);
  directions_.clear();
  batch.assign(1, gains_);
  for (int j = 0; j < options().directions; ++j) {
    const Gains& delta = directions_.emplace_back(SearchDirection(options(), iteration(), j));
    for (const double sign : {1.0, -1.0}) batch.push_back(Moved(sign * scale, delta));
  }
}

absl::StatusOr<IterationRecord> ArsSearch::Learn(std::span<const EpisodeResult> results) {
  std::vector<Pair> pairs = UsablePairs(results, directions_);
  if (pairs.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("iteration ", iteration(), ": all ", options().directions,
                     " pairs of episodes left the domain or failed, so there is no cost to improve"));
  }
  IterationRecord record{.gains = gains_, .pairs_left_out = options().directions - static_cast<int>(pairs.size())};
  SetEpisode(results[0], record);
  record.pairs_not_settled = static_cast<int>(std::ranges::count_if(pairs, [](const Pair& p) {
    return p.plus->outcome == Outcome::kNotSettled || p.minus->outcome == Outcome::kNotSettled;
  }));
  KeepTop(pairs, static_cast<std::size_t>(options().ars_variants.top_directions));
  const PairStatistics statistics = Summarise(pairs);
  record.cost_std = statistics.cost_std;
  if (statistics.cost_std > 0) {
    const double step =
        options().step_size * Factor(options().ars_variants.step_schedule, iteration(), options().iterations);
    gains_ = Moved(-step / (static_cast<double>(pairs.size()) * statistics.cost_std), statistics.ascent);
  }
  return record;
}

}  // namespace orbitune
