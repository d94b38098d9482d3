#include "core/search/options.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"

namespace orbitune {
namespace {

void CheckInteger(FieldErrors& errors, std::string_view field, std::int64_t low, std::int64_t high,
                  std::int64_t value) {
  if (value >= low && value <= high) return;
  errors.Add(field, absl::StrCat("in [", low, ", ", high, "]"), absl::StrCat(value));
}

void CheckPositive(FieldErrors& errors, std::string_view field, double value) {
  if (!(std::isfinite(value) && value > 0)) errors.AddNumber(field, "> 0 and finite", value);
}

// A standard deviation or a step in ln K: e^5 is a factor of 150.
void CheckLogStep(FieldErrors& errors, std::string_view field, double value) {
  if (!(value >= 1e-6 && value <= 5)) errors.AddNumber(field, "in [1e-6, 5]", value);
}

void CheckGains(FieldErrors& errors, const SearchOptions& o) {
  const std::string allowed = absl::StrCat("in [gain_floor, ", SearchOptions::kMaxGain, "] = [",
                                           FormatNumber(o.gain_floor), ", ", SearchOptions::kMaxGain, "]");
  for (std::size_t i = 0; i < kGainCount; ++i) {
    const double gain = o.initial_gains[i];
    if (!(gain >= o.gain_floor && gain <= SearchOptions::kMaxGain)) {
      errors.AddNumber(absl::StrCat("initial_gains.k", i + 1), allowed, gain);
    }
    const double std = o.exploration_std[i];
    if (!(std >= 0 && std <= SearchOptions::kMaxGain)) {
      errors.AddNumber(absl::StrCat("exploration_std.k", i + 1), absl::StrCat("in [0, ", SearchOptions::kMaxGain, "]"),
                       std);
    }
  }
  if (std::ranges::all_of(o.exploration_std, [](double std) { return std == 0; })) {
    errors.Add("exploration_std", "> 0 for at least one gain", "0 for all");
  }
}

}  // namespace

absl::Status SearchOptions::Validate() const {
  FieldErrors errors;
  CheckInteger(errors, "iterations", 1, kMaxIterations, iterations);
  CheckInteger(errors, "directions", 1, kMaxDirections, directions);
  CheckPositive(errors, "step_size", step_size);
  CheckPositive(errors, "exploration_scale", exploration_scale);
  CheckPositive(errors, "gain_floor", gain_floor);
  CheckGains(errors, *this);
  CheckInteger(errors, "max_episodes", 0, kMaxEpisodes, max_episodes);
  CheckInteger(errors, "plateau_stop.iterations", 0, kMaxIterations, plateau_stop.iterations);
  if (!(plateau_stop.min_improvement >= 0 && plateau_stop.min_improvement < 1)) {
    errors.AddNumber("plateau_stop.min_improvement", "in [0, 1)", plateau_stop.min_improvement);
  }
  CheckInteger(errors, "ars_variants.top_directions", 0, std::clamp(directions, 1, kMaxDirections),
               ars_variants.top_directions);
  CheckInteger(errors, "cma_es.population", 4, kMaxPopulation, cma_es.population);
  CheckInteger(errors, "cma_es.restarts", 0, kMaxRestarts, cma_es.restarts);
  CheckLogStep(errors, "cma_es.initial_sigma", cma_es.initial_sigma);
  if (!(cma_es.population_growth >= 1 && cma_es.population_growth <= 4)) {
    errors.AddNumber("cma_es.population_growth", "in [1, 4]", cma_es.population_growth);
  }
  CheckLogStep(errors, "nelder_mead.initial_step", nelder_mead.initial_step);
  CheckInteger(errors, "nelder_mead.restarts", 0, kMaxRestarts, nelder_mead.restarts);
  return errors.ToStatus();
}

Gains WithinBounds(const SearchOptions& options, Gains gains) {
  for (double& k : gains) k = std::min(std::max(k, options.gain_floor), SearchOptions::kMaxGain);
  return gains;
}

}  // namespace orbitune
