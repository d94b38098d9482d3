#include "core/search/optimiser.h"

#include <cmath>

#include "core/base/check.h"
#include "core/search/ars.h"
#include "core/search/cma_es.h"
#include "core/search/nelder_mead.h"

namespace orbitune {
namespace {

// Before the algorithm's own state in a checkpoint: the plateau's cost and iteration.
constexpr std::size_t kCommonState = 2;

}  // namespace

bool Optimiser::done() const {
  if (iteration_ == 1) return false;
  if (iteration_ > options_.iterations || exhausted()) return true;
  const PlateauStop& plateau = options_.plateau_stop;
  if (plateau.iterations > 0 && iteration_ - 1 - level_iteration_ >= plateau.iterations) return true;
  return options_.max_episodes > 0 && episodes_ + std::ssize(batch_) > options_.max_episodes;
}

absl::StatusOr<IterationRecord> Optimiser::Update(std::span<const EpisodeResult> results) {
  ORBITUNE_CHECK(results.size() == batch_.size());
  absl::StatusOr<IterationRecord> record = Learn(results);
  if (!record.ok()) return record;
  episodes_ += std::ssize(batch_);
  record->iteration = iteration_;
  record->episodes = episodes_;
  WatchPlateau(*record);
  ++iteration_;
  Propose(batch_);
  return record;
}

void Optimiser::WatchPlateau(const IterationRecord& record) {
  if (options_.plateau_stop.iterations == 0) return;
  const bool first = level_iteration_ == 0;
  const bool lower = record.cost < level_cost_ - options_.plateau_stop.min_improvement * std::abs(level_cost_);
  if (!first && !lower && !(std::isnan(level_cost_) && HasCost(record.outcome))) return;
  level_cost_ = record.cost;
  level_iteration_ = iteration_;
}

std::vector<double> Optimiser::checkpoint() const {
  std::vector<double> own;
  Save(own);
  if (own.empty() && options_.plateau_stop.iterations == 0) return {};
  std::vector<double> state{level_cost_, static_cast<double>(level_iteration_)};
  state.insert(state.end(), own.begin(), own.end());
  return state;
}

absl::Status Optimiser::Resume(const IterationRecord& last, std::span<const double> checkpoint) {
  const absl::Status fault = absl::DataLossError("the checkpoint is not one of this search");
  if (!checkpoint.empty()) {
    if (checkpoint.size() < kCommonState || !(checkpoint[1] >= 0 && checkpoint[1] <= last.iteration)) return fault;
    level_cost_ = checkpoint[0];
    level_iteration_ = static_cast<int>(checkpoint[1]);
    checkpoint = checkpoint.subspan(kCommonState);
  } else if (options_.plateau_stop.iterations != 0) {
    return fault;
  }
  iteration_ = last.iteration;
  if (!Restore(checkpoint, last)) return fault;
  Propose(batch_);
  episodes_ = last.episodes - std::ssize(batch_);
  return absl::OkStatus();
}

std::unique_ptr<Optimiser> MakeOptimiser(const SearchOptions& options) {
  switch (options.algorithm) {
    case Algorithm::kArs:
      break;
    case Algorithm::kCmaEs:
      return std::make_unique<CmaEs>(options);
    case Algorithm::kNelderMead:
      return std::make_unique<NelderMead>(options);
  }
  return std::make_unique<ArsSearch>(options);
}

absl::Status RunSearch(const SearchOptions& options, const Evaluate& evaluate,
                       const std::function<void(const IterationRecord&)>& observe) {
  if (absl::Status status = options.Validate(); !status.ok()) return status;
  const std::unique_ptr<Optimiser> search = MakeOptimiser(options);
  std::vector<EpisodeResult> results;
  while (!search->done()) {
    results.assign(search->batch().size(), {});
    evaluate(search->batch(), results);
    const auto record = search->Update(results);
    if (!record.ok()) return record.status();
    observe(*record);
  }
  return absl::OkStatus();
}

IterationRecord RecordOfCandidates(std::span<const Gains> batch, std::span<const EpisodeResult> results) {
  std::size_t best = 0;
  IterationRecord record;
  double sum = 0;
  int used = 0;
  for (std::size_t j = 0; j < results.size(); ++j) {
    if (BetterResult(results[j], results[best])) best = j;
    if (!HasCost(results[j].outcome)) continue;
    ++used;
    sum += results[j].cost;
    if (results[j].outcome == Outcome::kNotSettled) ++record.pairs_not_settled;
  }
  double squares = 0;
  for (const EpisodeResult& r : results) {
    if (HasCost(r.outcome)) squares += (r.cost - sum / used) * (r.cost - sum / used);
  }
  record.gains = batch[best];
  SetEpisode(results[best], record);
  record.cost_std = used > 0 ? std::sqrt(squares / used) : 0;
  record.pairs_left_out = static_cast<int>(results.size()) - used;
  return record;
}

}  // namespace orbitune
