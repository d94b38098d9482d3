#include "client/cli/progress.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/cli/format.h"

namespace orbitune::cli {
namespace {

constexpr double kRateWindow_s = 5;
constexpr double kRateSpacing_s = 0.1;
constexpr std::size_t kBarWidth = 20;
constexpr std::size_t kNarrowBarWidth = 10;
constexpr int kWide = 100;  // columns

std::string Bar(std::size_t width, int done, int total) {
  if (width == 0) return "";
  const double part = total > 0 ? std::clamp(1.0 * done / total, 0.0, 1.0) : 0;
  const auto filled = static_cast<std::size_t>(part * static_cast<double>(width));
  return absl::StrCat("[", std::string(filled, '#'), std::string(width - filled, '.'), "]");
}

// The pieces in the order shown; the empty ones take no room.
struct Pieces {
  std::size_t bar_width = 0;
  std::string head, gains, rate, left;
};

std::string Join(const Pieces& pieces, int done, int total) {
  std::vector<std::string> parts = {Bar(pieces.bar_width, done, total), pieces.head, pieces.gains, pieces.rate,
                                    pieces.left};
  parts.erase(std::remove(parts.begin(), parts.end(), ""), parts.end());
  return absl::StrJoin(parts, "  ");
}

std::string Head(const v1::Job& job) {
  std::string head;
  if (job.state() != v1::JOB_STATE_RUNNING) absl::StrAppend(&head, StateText(job.state()), "  ");
  absl::StrAppend(&head, job.completed_iterations(), "/", ExpectedIterations(job));
  if (!job.has_latest_iteration()) return head;
  const std::optional<double> cost = CostOf(job.latest_iteration());
  absl::StrAppend(&head, "  J ", cost ? Human(cost) : OutcomeText(job.latest_iteration().outcome()));
  const std::optional<double> reduction = ReductionPercent(CostOf(job.initial_iteration()), cost);
  if (reduction) absl::StrAppend(&head, absl::StrFormat(" (%+.1f %%)", -*reduction));
  return head;
}

}  // namespace

void RateMeter::Add(double now_s, int iteration) {
  if (!samples_.empty() && iteration < samples_.back().iteration) samples_.clear();
  if (samples_.size() >= 2 && now_s - samples_[samples_.size() - 2].time_s < kRateSpacing_s) {
    samples_.back() = {now_s, iteration};
  } else {
    samples_.push_back({now_s, iteration});
  }
  while (samples_.size() > 2 && samples_.front().time_s < now_s - kRateWindow_s) samples_.pop_front();
}

std::optional<double> RateMeter::PerSecond() const {
  if (samples_.size() < 2) return std::nullopt;
  const double seconds = samples_.back().time_s - samples_.front().time_s;
  const int iterations = samples_.back().iteration - samples_.front().iteration;
  if (seconds < kRateSpacing_s || iterations == 0) return std::nullopt;
  return iterations / seconds;
}

std::string ProgressLine(const v1::Job& job, std::optional<double> iterations_per_s, int width) {
  const int done = job.completed_iterations();
  const int total = ExpectedIterations(job);
  const std::size_t room = static_cast<std::size_t>(std::max(width, 0));
  Pieces pieces;
  pieces.bar_width = width >= kWide ? kBarWidth : kNarrowBarWidth;
  pieces.head = Head(job);
  if (job.has_latest_iteration()) pieces.gains = absl::StrCat("K ", GainsText(job.latest_iteration().gains(), 3));
  if (iterations_per_s && job.state() == v1::JOB_STATE_RUNNING) {
    pieces.rate = absl::StrCat(Human(*iterations_per_s, 3), " it/s");
    pieces.left = absl::StrCat(HumanDuration(std::ceil(std::max(total - done, 0) / *iterations_per_s)), " left");
  }
  const auto fits = [&] { return Join(pieces, done, total).size() <= room; };
  while (!fits() && !pieces.gains.empty()) {
    // Whole gains only: "K 0.1 1 1 1 10" -> "K 0.1 1 1 1 ..." -> ... -> nothing.
    std::vector<std::string> words = absl::StrSplit(pieces.gains, ' ');
    if (words.back() == "...") words.pop_back();
    words.back() = "...";
    pieces.gains = words.size() > 2 ? absl::StrJoin(words, " ") : "";
  }
  if (!fits()) pieces.rate.clear();
  if (!fits()) pieces.bar_width = 0;
  if (!fits()) pieces.left.clear();
  return Join(pieces, done, total).substr(0, room);
}

std::string IterationLine(const v1::Iteration& iteration, const v1::Job& job) {
  const std::optional<double> cost = CostOf(iteration);
  std::string line = absl::StrCat(
      "iteration ", iteration.iteration(), "/", ExpectedIterations(job), "  J ", Human(cost), "  reduction ",
      Percent(ReductionPercent(CostOf(job.initial_iteration()), cost)), "  K ", GainsText(iteration.gains()));
  if (iteration.outcome() != v1::OUTCOME_SETTLED) absl::StrAppend(&line, "  ", OutcomeText(iteration.outcome()));
  return line;
}

}  // namespace orbitune::cli
