#include "server/jobs/job_run.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "core/library/history_digest.h"
#include "core/simd/engine.h"
#include "core/simd/lane_kernel.h"

namespace orbitune {
namespace {

// What a job takes in its turn however large its batches, so that a small job beside it gets on, and a stop waits for
// little; some times the lanes of the widest vector, so that they are used.
constexpr std::size_t kLargestShare = 64;

// Iterations that take less may put episodes off; records are then late by no more than a few times this.
constexpr std::chrono::milliseconds kQuickIteration(5);

}  // namespace

absl::StatusOr<std::shared_ptr<JobRun>> JobRun::Start(const JobRecord& record) {
  // The spec was validated when the job was created.
  std::vector<PreparedScenario> prepared;
  for (const OrbitState& start : record.spec.starts()) {
    auto one = Prepare(record.spec.scenario, start);
    if (!one.ok()) return one.status();
    prepared.push_back(*std::move(one));
  }
  std::shared_ptr<JobRun> run(new JobRun(std::move(prepared)));
  if (absl::Status status = run->StartSearch(record); !status.ok()) return status;
  run->NextBatch(record);
  return run;
}

absl::Status JobRun::StartSearch(const JobRecord& record) {
  search_.emplace(record.spec.scenario.search, record.spec.objective, prepared_.size());
  digest_ = record.provenance->digest;
  const std::vector<EngineStretch>& engines = record.provenance->engines;
  if (engines.empty() || engines.back().engine != CurrentEngine()) new_engine_ = CurrentEngine();
  if (!record.latest) return absl::OkStatus();
  replayed_ = record.latest;
  return search_->Resume(*record.latest, record.checkpoint);
}

JobRun::Share JobRun::Claim(std::size_t threads) {
  const std::size_t lanes = simd::LaneCount();
  const std::size_t equal = (results_.size() - put_off_ + threads * lanes - 1) / (threads * lanes) * lanes;
  const Share share{claimed_, std::min({equal, kLargestShare, results_.size() - claimed_})};
  claimed_ += share.count;
  return share;
}

BatchUse JobRun::Fly(Share share) {
  if (!search_) return FlyReport(share);
  std::vector<BatchEpisode> episodes;
  for (std::size_t e = share.begin; e < share.begin + share.count; ++e) episodes.push_back(EpisodeAt(e));
  return SimulateBatch(episodes, std::span(results_).subspan(share.begin, share.count), [this] { return Unwanted(); });
}

BatchEpisode JobRun::EpisodeAt(std::size_t e) const {
  if (e >= searched_) return {.problem = &prepared_[0].problem, .gains = late_[e - searched_].record.gains};
  return {.problem = &prepared_[search_->initial_condition(e)].problem, .gains = search_->gains(e)};
}

// The report's episodes go the whole horizon and have their effort measured.
BatchUse JobRun::FlyReport(Share share) {
  BatchUse use;
  for (std::size_t e = share.begin; e < share.begin + share.count; ++e) {
    const std::size_t choice = e / prepared_.size();
    const WatchedEpisode episode = FlyWatched(prepared_[e % prepared_.size()].problem, report_gains_[choice],
                                              {.early_exit = false, .cancelled = [this] { return Unwanted(); }});
    results_[e] = episode.result;
    use.scalar_steps += episode.result.steps + episode.result.rejected_steps;
    if (!episode.lyapunov_decreasing && choice + 1 == report_gains_.size()) lyapunov_decreasing_ = false;
  }
  return use;
}

bool JobRun::Finish(Share share) {
  finished_ += share.count;
  return finished_ == results_.size();
}

BatchOutcome JobRun::FinishSearchBatch() {
  BatchOutcome learnt = LearnFromBatch();
  BatchOutcome outcome{.iterations = {}, .status = std::move(learnt.status)};
  for (BatchOutcome::Iteration& i : learnt.iterations) {
    if (replayed_) {
      // The digest has it already.
      if (absl::Status status = CheckReplayed(i.record); !status.ok()) return {.iterations = {}, .status = status};
      replayed_.reset();
      continue;
    }
    digest_ = i.continuation.digest = ExtendHistory(digest_, i.record);
    i.continuation.engine = std::exchange(new_engine_, std::nullopt);
    outcome.iterations.push_back(std::move(i));
  }
  return outcome;
}

BatchOutcome JobRun::LearnFromBatch() {
  BatchOutcome outcome;
  for (std::size_t i = 0; i < late_.size(); ++i) SetEpisode(results_[searched_ + i], late_[i].record);
  outcome.iterations = std::exchange(late_, {});
  if (searched_ == 0) return outcome;
  std::vector<double> checkpoint = search_->checkpoint();
  const Gains first = search_->gains(0);
  const auto record = search_->Update(std::span(results_).first(searched_));
  updated_ = true;
  if (record.ok()) {
    (put_off_ > 0 ? incomplete_ : outcome.iterations).push_back({*record, {.checkpoint = std::move(checkpoint)}});
    return outcome;
  }
  // The message tells of the first episode.
  if (put_off_ > 0) FlyAtOnce(first, results_[0]);
  for (BatchOutcome::Iteration& i : incomplete_) {
    EpisodeResult own;
    FlyAtOnce(i.record.gains, own);
    SetEpisode(own, i.record);
    outcome.iterations.push_back(std::move(i));
  }
  incomplete_.clear();
  outcome.status = record.status();
  if (const std::string why = DescribeFirst(); !why.empty()) {
    outcome.status = absl::Status(record.status().code(), absl::StrCat(record.status().message(), ". ", why));
  }
  return outcome;
}

absl::Status JobRun::CheckReplayed(const IterationRecord& record) const {
  if (Identical(*replayed_, record)) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat(
      "iteration ", record.iteration,
      ", run again to go on from it, differs from the one stored: this server's numerics are not those that the job "
      "was begun with"));
}

void JobRun::FlyAtOnce(const Gains& gains, EpisodeResult& result) const {
  const BatchEpisode episode{.problem = &prepared_[0].problem, .gains = gains};
  SimulateBatch({&episode, 1}, {&result, 1}, [this] { return Unwanted(); });
}

// Why there is no cost under the first gains of the batch; empty if there is one.
std::string JobRun::DescribeFirst() const {
  for (std::size_t i = 0; i < prepared_.size(); ++i) {
    if (HasCost(results_[i].outcome)) continue;
    const std::string from = prepared_.size() == 1 ? "" : absl::StrCat("from initial condition ", i, ", ");
    return absl::StrCat("Under K(", search_->iteration(), "): ", from, DescribeOutcome(results_[i], prepared_[i]));
  }
  return "";
}

void JobRun::NextBatch(const JobRecord& record) {
  const bool searching = search_ && (!updated_ || !search_->done());
  if (!searching && incomplete_.empty()) search_.reset();
  const auto now = std::chrono::steady_clock::now();
  put_off_ = searching && updated_ && now - begun_ < kQuickIteration && search_->first_is_for_the_record() ? 1 : 0;
  begun_ = now;
  if (put_off_ == 0 || incomplete_.size() >= simd::LaneCount()) late_ = std::exchange(incomplete_, {});
  if (!search_) report_gains_ = {record.first->gains, record.latest->gains, record.best->gains};
  searched_ = searching ? search_->episodes() : search_ ? 0 : report_gains_.size() * prepared_.size();
  results_.assign(searched_ + late_.size(), {});
  claimed_ = finished_ = put_off_;
}

}  // namespace orbitune
