#include "core/search/nelder_mead.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"

namespace orbitune {
namespace {

// Gao and Han: reflection 1, expansion 1 + 2/n, contraction 3/4 - 1/(2n), shrinkage 1 - 1/n.
constexpr double kExpansion = 1.4;
constexpr double kContraction = 0.65;
constexpr double kShrinkage = 0.8;
enum Candidate : std::size_t { kReflected, kExpanded, kOutside, kInside };
constexpr std::array kAlong{1.0, kExpansion, kContraction, -kContraction};  // from the centroid, away from the worst

// A simplex has converged when it is smaller than this in ln K, or its costs differ by less in parts of themselves.
constexpr double kSmallestEdge = 1e-4;
constexpr double kSmallestSpread = 1e-7;

EpisodeResult OutcomeAndCost(const EpisodeResult& result) { return {.outcome = result.outcome, .cost = result.cost}; }

}  // namespace

NelderMead::NelderMead(const SearchOptions& options) : Optimiser(options) {
  for (Corner& corner : corners_) corner.x = ToLog(options.initial_gains);
  Begin();
}

void NelderMead::Propose(std::vector<Gains>& batch) {
  const LogGains& best = corners_.front().x;
  std::vector<LogGains> x;
  switch (phase_) {
    case Phase::kFirst:
      batch.assign(1, options().initial_gains);
      samples_.assign(1, best);
      return;
    case Phase::kCorners:
      for (int i = 0; i < kGainCount; ++i) {
        // Every other simplex opens to the other side.
        x.push_back(best);
        x.back()[i] += (run_ % 2 == 0 ? 1 : -1) * options().nelder_mead.initial_step;
      }
      break;
    case Phase::kStep: {
      LogGains centroid = LogGains::Zero();
      for (int i = 0; i < kGainCount; ++i) centroid += corners_[static_cast<std::size_t>(i)].x / kGainCount;
      for (const double along : kAlong) x.push_back(centroid + along * (centroid - corners_.back().x));
      break;
    }
    case Phase::kShrink:
      for (std::size_t i = 1; i < corners_.size(); ++i) x.push_back(best + kShrinkage * (corners_[i].x - best));
      break;
  }
  batch.clear();
  samples_.clear();
  for (const LogGains& sample : x) {
    batch.push_back(FromLog(options(), sample));
    samples_.push_back(ToLog(batch.back()));
  }
}

absl::StatusOr<IterationRecord> NelderMead::Learn(std::span<const EpisodeResult> results) {
  IterationRecord record = RecordOfCandidates(batch(), results);
  if (phase_ != Phase::kFirst && !HasCost(record.outcome) && !HasCost(corners_.front().result.outcome)) {
    return absl::FailedPreconditionError(
        absl::StrCat("iteration ", iteration(), ": K(1) and all ", results.size(),
                     " candidates left the domain or failed, so there is no cost to improve"));
  }
  switch (phase_) {
    case Phase::kFirst:
      corners_.front().result = OutcomeAndCost(results[0]);
      phase_ = Phase::kCorners;
      return record;
    case Phase::kStep:
      Step(results);
      break;
    case Phase::kCorners:
    case Phase::kShrink:
      ReplaceOthers(results);
      phase_ = Phase::kStep;
      break;
  }
  Sort();
  if (HasConverged()) {
    ++run_;
    phase_ = Phase::kCorners;
  }
  return record;
}

void NelderMead::Step(std::span<const EpisodeResult> results) {
  const auto take = [&](Candidate c) { corners_.back() = {samples_[c], OutcomeAndCost(results[c])}; };
  const EpisodeResult& reflected = results[kReflected];
  if (BetterResult(reflected, corners_.front().result)) {
    return take(BetterResult(results[kExpanded], reflected) ? kExpanded : kReflected);
  }
  if (BetterResult(reflected, corners_[kGainCount - 1].result)) return take(kReflected);
  const bool outside = BetterResult(reflected, corners_.back().result);
  const Candidate contracted = outside ? kOutside : kInside;
  if (BetterResult(results[contracted], outside ? reflected : corners_.back().result)) return take(contracted);
  phase_ = Phase::kShrink;
}

void NelderMead::ReplaceOthers(std::span<const EpisodeResult> results) {
  for (std::size_t i = 0; i < results.size(); ++i) corners_[i + 1] = {samples_[i], OutcomeAndCost(results[i])};
}

void NelderMead::Sort() {
  std::ranges::stable_sort(corners_, [](const Corner& a, const Corner& b) { return BetterResult(a.result, b.result); });
}

bool NelderMead::HasConverged() const {
  double edge = 0;
  for (const Corner& corner : corners_) {
    edge = std::max(edge, (corner.x - corners_.front().x).lpNorm<Eigen::Infinity>());
  }
  const EpisodeResult& best = corners_.front().result;
  const EpisodeResult& worst = corners_.back().result;
  return edge < kSmallestEdge || (HasCost(worst.outcome) && worst.outcome == best.outcome &&
                                  worst.cost - best.cost <= kSmallestSpread * std::abs(best.cost));
}

void NelderMead::Save(std::vector<double>& state) const {
  state.push_back(static_cast<double>(phase_));
  state.push_back(run_);
  for (const Corner& corner : corners_) {
    state.insert(state.end(), corner.x.begin(), corner.x.end());
    state.push_back(static_cast<double>(corner.result.outcome));
    state.push_back(corner.result.cost);
  }
}

bool NelderMead::Restore(std::span<const double> state, const IterationRecord&) {
  constexpr std::size_t kCornerSize = kGainCount + 2;
  if (state.size() != 2 + (kGainCount + 1) * kCornerSize) return false;
  if (!(state[0] >= 0 && state[0] <= static_cast<double>(Phase::kShrink))) return false;
  phase_ = static_cast<Phase>(static_cast<int>(state[0]));
  run_ = static_cast<int>(state[1]);
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    const double* corner = state.data() + 2 + i * kCornerSize;
    const double outcome = corner[kGainCount];
    if (!(outcome >= 0 && outcome <= static_cast<double>(Outcome::kNumericalFailure))) return false;
    corners_[i].x = Eigen::Map<const LogGains>(corner);
    corners_[i].result = {.outcome = static_cast<Outcome>(static_cast<int>(outcome)), .cost = corner[kGainCount + 1]};
  }
  return true;
}

}  // namespace orbitune
