#include "server/jobs/verify.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "core/library/history_digest.h"
#include "core/library/scenario_digest.h"
#include "core/search/ensemble_search.h"
#include "core/simd/batch_simulator.h"
#include "core/simd/engine.h"

namespace orbitune {
namespace {

constexpr int kPage = 1000;
constexpr std::size_t kEpisodesAtOnce = 256;

// A job's stored iterations, a page at a time. Those that a job had once are there for good, unless it is deleted.
class StoredHistory {
 public:
  StoredHistory(const JobStore& store, const std::string& job_id) : store_(store), job_id_(job_id) {}

  absl::StatusOr<IterationRecord> At(int iteration) {
    if (page_.empty() || iteration < page_.front().iteration || iteration > page_.back().iteration) {
      auto page = store_.ListIterations(job_id_, iteration - 1, kPage);
      if (!page.ok()) return page.status();
      if (page->empty()) return absl::DataLossError(absl::StrCat("iteration ", iteration, " is missing"));
      page_ = *std::move(page);
    }
    return page_[static_cast<std::size_t>(iteration - page_.front().iteration)];
  }

 private:
  const JobStore& store_;
  const std::string job_id_;
  std::vector<IterationRecord> page_;
};

std::vector<std::string> EngineDifferences(const Provenance& provenance) {
  std::vector<std::string> differences;
  const Engine now = CurrentEngine();
  for (const auto& [first_iteration, then] : provenance.engines) {
    const auto note = [&, from = first_iteration](const char* what, const std::string& there, const std::string& here) {
      if (there != here) {
        differences.push_back(
            absl::StrCat("from iteration ", from, " on, ", what, ": ", there, " then, ", here, " now"));
      }
    };
    const auto fused = [](const Engine& engine) {
      return absl::StrCat(engine.fused_multiply_add ? "fused" : "not fused", " (", engine.simd_target, ")");
    };
    note("engine version", then.version, now.version);
    if (then.fused_multiply_add != now.fused_multiply_add) note("multiply and add", fused(then), fused(now));
    note("libraries", then.libraries, now.libraries);
  }
  return differences;
}

class Verifier {
 public:
  Verifier(const JobStore& store, JobRecord job, VerifyRange range, const VerifyObserver& observe)
      : job_(std::move(job)), stored_(store, job_.id), range_(range), observe_(observe) {}

  absl::StatusOr<Verification> Run() {
    if (absl::Status status = CheckRange(); !status.ok()) return status;
    if (absl::Status status = Chain(); !status.ok()) return status;
    if (absl::Status status = Prepare(); !status.ok()) return status;
    if (absl::Status status = RunAgain(); !status.ok()) return status;
    Conclude();
    return std::move(out_);
  }

 private:
  absl::Status CheckRange() {
    const int newest = out_.completed_iterations = job_.completed_iterations();
    if (newest == 0) {
      return WithReason(
          absl::FailedPreconditionError(absl::StrCat("jobs/", job_.id, " has no iteration yet that could be verified")),
          "JOB_STATE");
    }
    if (range_.first == 0) range_.first = 1;
    if (range_.last == 0) range_.last = newest;
    if (removed() && (range_.first != 1 || range_.last != newest)) {
      return WithReason(absl::FailedPreconditionError(absl::StrCat("jobs/", job_.id, ": its iterations were removed; ",
                                                                   "only the whole of it can be verified")),
                        "ITERATIONS_REMOVED");
    }
    FieldErrors errors;
    if (range_.first < 1 || range_.first > newest) {
      errors.AddNumber("first_iteration", absl::StrCat("in [1, ", newest, "], or 0 for 1"), range_.first);
    } else if (range_.last < range_.first || range_.last > newest) {
      errors.AddNumber("last_iteration", absl::StrCat("in [", range_.first, ", ", newest, "], or 0 for the newest"),
                       range_.last);
    }
    out_.first_iteration = range_.first;
    out_.last_iteration = range_.last;
    return errors.ToStatus();
  }

  // All iterations but the first, the best and the last, by retention.
  bool removed() const { return job_.iterations_removed_us != 0; }

  // Nothing, where it was removed.
  absl::StatusOr<std::optional<IterationRecord>> StoredAt(int iteration) {
    if (removed()) {
      for (const auto& left : {job_.first, job_.best, job_.latest}) {
        if (left && left->iteration == iteration) return left;
      }
      return std::nullopt;
    }
    auto record = stored_.At(iteration);
    if (!record.ok()) return record.status();
    return *record;
  }

  bool Goes(int iteration) const { return observe_({out_.first_iteration, out_.last_iteration, iteration}); }

  // What was recorded, against what is stored.
  absl::Status Chain() {
    const JobSpec& spec = job_.spec;
    const std::string scenario_digest =
        job_.provenance ? job_.provenance->scenario_digest : ScenarioDigest(spec.scenario);
    inputs_ = Sha256(
        InputsText(scenario_digest, spec.scenario, spec.initial_condition, spec.initial_conditions, spec.objective));
    out_.digest = inputs_;
    for (int i = 1; i <= out_.completed_iterations && !removed(); ++i) {
      if (i % kPage == 1 && !Goes(0)) return absl::CancelledError("cancelled");
      const auto record = stored_.At(i);
      if (!record.ok()) return record.status();
      out_.digest = ExtendHistory(out_.digest, *record);
    }
    if (!job_.provenance) return absl::OkStatus();
    out_.recorded_digest = job_.provenance->digest;
    out_.engine_differences = EngineDifferences(*job_.provenance);
    inputs_altered_ = job_.provenance->inputs_digest != ToHex(inputs_);
    altered_ = inputs_altered_ || (!removed() && out_.digest != *out_.recorded_digest);
    return absl::OkStatus();
  }

  absl::Status Prepare() {
    for (const OrbitState& start : job_.spec.starts()) {
      auto one = orbitune::Prepare(job_.spec.scenario, start);
      if (!one.ok()) return one.status();
      prepared_.push_back(*std::move(one));
    }
    search_.emplace(job_.spec.scenario.search, job_.spec.objective, prepared_.size());
    out_.first_iteration = search_->needs_no_checkpoint() ? std::max(range_.first - 1, 1) : 1;
    if (out_.first_iteration == 1) return absl::OkStatus();
    const auto before = stored_.At(out_.first_iteration);
    return before.ok() ? search_->Resume(*before, {}) : before.status();
  }

  // FAILED_PRECONDITION where the search cannot go on.
  absl::StatusOr<IterationRecord> RunOne() {
    results_.assign(search_->episodes(), {});
    std::vector<BatchEpisode> episodes;
    for (std::size_t begin = 0; begin < results_.size(); begin += kEpisodesAtOnce) {
      if (!Goes(search_->iteration() - 1)) return absl::CancelledError("cancelled");
      const std::size_t end = std::min(begin + kEpisodesAtOnce, results_.size());
      episodes.clear();
      for (std::size_t e = begin; e < end; ++e) {
        episodes.push_back({.problem = &prepared_[search_->initial_condition(e)].problem, .gains = search_->gains(e)});
      }
      const auto cancelled = [this] { return !Goes(search_->iteration() - 1); };
      if (SimulateBatch(episodes, std::span(results_).subspan(begin, end - begin), cancelled).cancelled) {
        return absl::CancelledError("cancelled");
      }
    }
    return search_->Update(results_);
  }

  // A job that has succeeded must also end where its search does.
  absl::Status RunAgain() {
    const bool to_the_end = job_.state == JobState::kSucceeded && range_.last == out_.completed_iterations;
    const bool whole = out_.first_iteration == 1 && range_.last == out_.completed_iterations;
    recomputed_ = inputs_;
    for (int i = out_.first_iteration; i <= range_.last || to_the_end; ++i) {
      const bool expected = i <= range_.last;
      absl::StatusOr<std::optional<IterationRecord>> there = std::optional<IterationRecord>();
      if (expected) there = StoredAt(i);
      if (!there.ok()) return there.status();
      std::optional<IterationRecord> here;
      if (!search_->done()) {
        auto record = RunOne();
        if (record.ok()) {
          here = *record;
        } else if (!absl::IsFailedPrecondition(record.status())) {
          return record.status();
        }
      }
      if (!expected && !here) break;
      if (expected && here) recomputed_ = ExtendHistory(recomputed_, *here);
      if (expected != here.has_value() || (*there && !Identical(**there, *here))) {
        if (!out_.first_difference) out_.first_difference = {.iteration = i, .stored = *there, .recomputed = here};
        // Only of what was altered or removed is it worth knowing what the whole would have come to.
        if (!(altered_ || removed()) || !whole || expected != here.has_value()) break;
      }
    }
    if (removed()) out_.digest = recomputed_;
    restored_ = altered_ && whole && recomputed_ == *out_.recorded_digest;
    return absl::OkStatus();
  }

  void Conclude() {
    const auto& difference = out_.first_difference;
    const bool other_digest = out_.recorded_digest && out_.digest != *out_.recorded_digest;
    out_.verdict = altered_                     ? Verdict::kAltered
                   : difference || other_digest ? Verdict::kDifferent
                                                : Verdict::kIdentical;
    if (inputs_altered_) {
      out_.conclusion = "the job's inputs are not those that it was created with";
    } else if (altered_) {
      out_.conclusion = "the stored iterations are not those of which the recorded digest was made";
      if (restored_) {
        absl::StrAppend(&out_.conclusion,
                        "; run again, the job gives that digest, so it is the iterations that were "
                        "altered");
      }
    } else if (removed() && out_.recorded_digest) {
      out_.conclusion = absl::StrCat("run again, the job gives ", other_digest ? "another" : "the same",
                                     " digest; its iterations were removed, but for the first, the best and the last");
    } else if (!difference && removed()) {
      out_.conclusion = "the first, the best and the last iteration come out the same; the others were removed";
    } else if (!difference) {
      out_.conclusion = absl::StrCat("iterations ", out_.first_iteration, " to ", out_.last_iteration,
                                     " come out the same, bit for bit");
    } else {
      out_.conclusion = "run again, the job does not give the stored iterations";
    }
    if (difference) DescribeDifference(*difference);
    if (!out_.recorded_digest) {
      absl::StrAppend(&out_.conclusion, "; the server that ran the job kept no digest to compare with");
    } else if (job_.provenance->backfilled > 0) {
      absl::StrAppend(&out_.conclusion, "; up to iteration ", job_.provenance->backfilled,
                      " the digest was made after the event, from what was stored");
    }
    if (out_.verdict == Verdict::kDifferent && !out_.engine_differences.empty()) {
      absl::StrAppend(&out_.conclusion, "; it was run by another engine, which may explain it");
    }
  }

  void DescribeDifference(const Verification::Difference& difference) {
    if (!difference.recomputed) {
      absl::StrAppend(&out_.conclusion, "; the search ends before iteration ", difference.iteration);
    } else if (!difference.stored) {
      absl::StrAppend(&out_.conclusion, "; the search goes on after iteration ", difference.iteration - 1,
                      ", where the history ends");
    } else {
      absl::StrAppend(&out_.conclusion, "; the first that differs is iteration ", difference.iteration);
    }
  }

  const JobRecord job_;
  StoredHistory stored_;
  VerifyRange range_;
  const VerifyObserver& observe_;

  std::vector<PreparedScenario> prepared_;
  std::optional<EnsembleSearch> search_;
  std::vector<EpisodeResult> results_;
  Digest inputs_{};
  Digest recomputed_{};          // of the iterations run again
  bool inputs_altered_ = false;  // and with them the digest
  bool altered_ = false;
  bool restored_ = false;  // run again, the job gives the recorded digest
  Verification out_;
};

}  // namespace

absl::StatusOr<Verification> VerifyJob(const JobStore& store, const std::string& job_id, VerifyRange range,
                                       const VerifyObserver& observe) {
  auto job = store.GetJob(job_id);
  if (!job.ok()) return job.status();
  return Verifier(store, *std::move(job), range, observe).Run();
}

}  // namespace orbitune
