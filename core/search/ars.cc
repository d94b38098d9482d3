#include "core/search/ars.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/random.h"

namespace orbitune {
namespace {

std::string Element(std::string_view field, int i) { return absl::StrCat(ToAbsl(field), ".k", i + 1); }

// The pairs of one iteration whose episodes both have a cost.
struct PairStatistics {
  int used = 0;
  int not_settled = 0;
  double cost_std = 0;  // sigma_J
  Gains ascent{};       // sum over the pairs of (J+ - J-) delta_j
};

PairStatistics Summarise(std::span<const EpisodeResult> results, const std::vector<Gains>& directions) {
  PairStatistics pairs;
  double sum = 0;
  const auto for_each_used = [&](auto&& visit) {
    for (std::size_t j = 0; j < directions.size(); ++j) {
      const EpisodeResult& plus = results[1 + 2 * j];
      const EpisodeResult& minus = results[2 + 2 * j];
      if (HasCost(plus.outcome) && HasCost(minus.outcome)) visit(plus, minus, directions[j]);
    }
  };
  for_each_used([&](const EpisodeResult& plus, const EpisodeResult& minus, const Gains& direction) {
    ++pairs.used;
    if (plus.outcome == Outcome::kNotSettled || minus.outcome == Outcome::kNotSettled) ++pairs.not_settled;
    sum += plus.cost;
    sum += minus.cost;
    for (std::size_t i = 0; i < kGainCount; ++i) pairs.ascent[i] += (plus.cost - minus.cost) * direction[i];
  });
  if (pairs.used == 0) return pairs;
  const double mean = sum / (2 * pairs.used);
  double squares = 0;
  for_each_used([&](const EpisodeResult& plus, const EpisodeResult& minus, const Gains&) {
    squares += (plus.cost - mean) * (plus.cost - mean);
    squares += (minus.cost - mean) * (minus.cost - mean);
  });
  pairs.cost_std = std::sqrt(squares / (2 * pairs.used));
  return pairs;
}

}  // namespace

absl::Status ArsOptions::Validate() const {
  FieldErrors errors;
  const auto positive = [&errors](std::string_view field, double value) {
    if (!(std::isfinite(value) && value > 0)) errors.AddNumber(field, "> 0 and finite", value);
  };
  if (iterations < 1 || iterations > kMaxIterations) {
    errors.AddNumber("iterations", absl::StrCat("in [1, ", kMaxIterations, "]"), iterations);
  }
  if (directions < 1 || directions > kMaxDirections) {
    errors.AddNumber("directions", absl::StrCat("in [1, ", kMaxDirections, "]"), directions);
  }
  positive("step_size", step_size);
  positive("exploration_scale", exploration_scale);
  positive("gain_floor", gain_floor);
  for (int i = 0; i < kGainCount; ++i) {
    const double gain = initial_gains[static_cast<std::size_t>(i)];
    if (!(gain >= gain_floor && gain <= kMaxGain)) {
      errors.AddNumber(
          Element("initial_gains", i),
          absl::StrCat("in [gain_floor, ", kMaxGain, "] = [", FormatNumber(gain_floor), ", ", kMaxGain, "]"), gain);
    }
    const double std = exploration_std[static_cast<std::size_t>(i)];
    if (!(std >= 0 && std <= kMaxGain)) {
      errors.AddNumber(Element("exploration_std", i), absl::StrCat("in [0, ", kMaxGain, "]"), std);
    }
  }
  if (std::ranges::all_of(exploration_std, [](double std) { return std == 0; })) {
    errors.Add("exploration_std", "> 0 for at least one gain", "0 for all");
  }
  return errors.ToStatus();
}

Gains SearchDirection(const ArsOptions& options, int iteration, int direction) {
  const RandomKey key{.seed = options.seed,
                      .stream = RandomStream::kSearchDirections,
                      .a = static_cast<std::uint32_t>(iteration),
                      .b = static_cast<std::uint32_t>(direction)};
  Gains delta;
  for (std::uint32_t i = 0; i < kGainCount; ++i) delta[i] = options.exploration_std[i] * StandardNormal(key, i);
  return delta;
}

ArsSearch::ArsSearch(const ArsOptions& options) : options_(options), iteration_(1), gains_(options.initial_gains) {
  FillBatch();
}

ArsSearch::ArsSearch(const ArsOptions& options, const IterationRecord& last)
    : options_(options), iteration_(last.iteration), gains_(last.gains) {
  FillBatch();
}

void ArsSearch::FillBatch() {
  directions_.clear();
  batch_.assign(1, gains_);
  for (int j = 0; j < options_.directions; ++j) {
    const Gains& delta = directions_.emplace_back(SearchDirection(options_, iteration_, j));
    for (const double sign : {1.0, -1.0}) {
      Gains& k = batch_.emplace_back(gains_);
      for (std::size_t i = 0; i < kGainCount; ++i) {
        k[i] =
            std::clamp(k[i] + sign * options_.exploration_scale * delta[i], options_.gain_floor, ArsOptions::kMaxGain);
      }
    }
  }
}

absl::StatusOr<IterationRecord> ArsSearch::Update(std::span<const EpisodeResult> results) {
  ORBITUNE_CHECK(results.size() == batch_.size());
  const EpisodeResult& own = results[0];
  const PairStatistics pairs = Summarise(results, directions_);
  if (pairs.used == 0) {
    return absl::FailedPreconditionError(
        absl::StrCat("iteration ", iteration_, ": all ", options_.directions,
                     " pairs of episodes left the domain or failed, so there is no cost to improve"));
  }
  IterationRecord record{.iteration = iteration_,
                         .gains = gains_,
                         .outcome = own.outcome,
                         .cost = own.cost,
                         .settling_samples = own.settling_samples,
                         .fuel_sum = own.fuel_sum,
                         .cost_std = pairs.cost_std,
                         .pairs_left_out = options_.directions - pairs.used,
                         .pairs_not_settled = pairs.not_settled};
  if (pairs.cost_std > 0) {
    const double scale = options_.step_size / (pairs.used * pairs.cost_std);
    for (std::size_t i = 0; i < kGainCount; ++i) {
      gains_[i] = std::clamp(gains_[i] - scale * pairs.ascent[i], options_.gain_floor, ArsOptions::kMaxGain);
    }
  }
  ++iteration_;
  FillBatch();
  return record;
}

absl::Status RunArs(const ArsOptions& options, const Evaluate& evaluate,
                    const std::function<void(const IterationRecord&)>& observe) {
  if (absl::Status status = options.Validate(); !status.ok()) return status;
  ArsSearch search(options);
  std::vector<EpisodeResult> results(search.batch().size());
  while (!search.done()) {
    evaluate(search.batch(), results);
    auto record = search.Update(results);
    if (!record.ok()) return record.status();
    observe(*record);
  }
  return absl::OkStatus();
}

}  // namespace orbitune
