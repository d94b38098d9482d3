#include "client/cli/watch_sinks.h"

#include "absl/strings/str_cat.h"
#include "client/cli/format.h"
#include "client/cli/json.h"
#include "client/cli/progress.h"

namespace orbitune::cli {
namespace {

std::string EventLine(const v1::WatchJobResponse& event, const v1::Job& job) {
  switch (event.event_case()) {
    case v1::WatchJobResponse::kSnapshot:
      return absl::StrCat(job.name(), "  ", StateText(job.state()), "  ",
                          job.scenario().empty() ? "own scenario" : Printable(job.scenario()), "  ",
                          job.completed_iterations(), "/", job.hyperparameters().iterations(), " iterations\n");
    case v1::WatchJobResponse::kIteration:
      return absl::StrCat(IterationLine(event.iteration(), job), "\n");
    case v1::WatchJobResponse::kStateChange:
      return absl::StrCat("state ", StateText(event.state_change().state()), "\n");
    case v1::WatchJobResponse::kGap:
      return absl::StrCat("gap: events ", event.gap().first_seq(), " to ", event.gap().last_seq(), " skipped\n");
    default:
      return "";
  }
}

}  // namespace

void LineSink::OnEvent(const v1::WatchJobResponse& event, const v1::Job& job) {
  out_ << (json_ ? JsonLine(event) : EventLine(event, job)) << std::flush;
}

void LineSink::OnNote(const std::string& note) { err_ << "orbitune: " << note << std::endl; }

}  // namespace orbitune::cli
