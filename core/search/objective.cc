#include "core/search/objective.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/check.h"
#include "core/sim/severity.h"

namespace orbitune {
namespace {

double Cvar(std::span<const double> ascending, double level) {
  const double tail = (1 - level) * static_cast<double>(ascending.size());  // how many, in parts
  double sum = 0;
  double left = tail;
  for (std::size_t i = ascending.size(); i > 0 && left > 0; --i) {
    const double weight = std::min(left, 1.0);
    sum += weight * ascending[i - 1];
    left -= weight;
  }
  return sum / tail;
}

}  // namespace

absl::Status Objective::Validate() const {
  const bool has_level = aggregate == Aggregate::kPercentile || aggregate == Aggregate::kCvar;
  if (has_level && !(level > 0 && level < 1)) return InvalidField("level", "in (0, 1) for PERCENTILE and CVAR", level);
  if (!has_level && level != 0) return InvalidField("level", "0 for MEAN and WORST", level);
  return absl::OkStatus();
}

double AggregateCosts(const Objective& objective, std::span<const double> costs) {
  ORBITUNE_CHECK(!costs.empty());
  const auto n = static_cast<double>(costs.size());
  if (objective.aggregate == Aggregate::kMean) {
    double sum = 0;
    for (const double cost : costs) sum += cost;
    return sum / n;
  }
  std::vector<double> ascending(costs.begin(), costs.end());
  std::ranges::sort(ascending);
  if (objective.aggregate == Aggregate::kWorst) return ascending.back();
  if (objective.aggregate == Aggregate::kCvar) return Cvar(ascending, objective.level);
  // 0.9 * 10 must be 9, whatever its last bit.
  const double rank = std::ceil(objective.level * n * (1 - 1e-12));
  return ascending[static_cast<std::size_t>(std::clamp(rank, 1.0, n)) - 1];
}

EpisodeResult AggregateResults(const Objective& objective, std::span<const EpisodeResult> results,
                               std::span<const double> baselines) {
  ORBITUNE_CHECK(!results.empty() && (!objective.relative_to_initial || baselines.size() == results.size()));
  const auto worst = std::ranges::max_element(results, [](const EpisodeResult& a, const EpisodeResult& b) {
    return Severity(a.outcome) < Severity(b.outcome);
  });
  if (!HasCost(worst->outcome)) return *worst;
  EpisodeResult all{.outcome = worst->outcome, .fuel_sum = 0};
  std::vector<double> costs;
  double samples = 0;
  for (std::size_t i = 0; i < results.size(); ++i) {
    costs.push_back(objective.relative_to_initial ? results[i].cost / baselines[i] : results[i].cost);
    samples += results[i].settling_samples;
    all.fuel_sum += results[i].fuel_sum;
    all.end_time = std::max(all.end_time, results[i].end_time);
  }
  const auto n = static_cast<double>(results.size());
  all.fuel_sum /= n;
  all.settling_samples = static_cast<int>(std::lround(samples / n));
  all.cost = AggregateCosts(objective, costs);
  return all;
}

}  // namespace orbitune
