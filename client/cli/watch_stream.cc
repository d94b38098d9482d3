#include "client/cli/watch_stream.h"

#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/format.h"

namespace orbitune::cli {
namespace {

constexpr int kIterationsPerMessage = 256;  // at most

void ApplyStateChange(const v1::StateChange& change, v1::Job* job) {
  job->set_state(change.state());
  *job->mutable_update_time() = change.time();
  if (change.state() == v1::JOB_STATE_RUNNING && !job->has_start_time()) *job->mutable_start_time() = change.time();
  if (Ended(change.state())) *job->mutable_end_time() = change.time();
  if (change.state() == v1::JOB_STATE_FAILED) job->set_error_message(change.message());
  if (change.has_report()) *job->mutable_report() = change.report();
}

}  // namespace

void ApplyEvent(const v1::WatchJobResponse& event, v1::Job* job) {
  switch (event.event_case()) {
    case v1::WatchJobResponse::kSnapshot:
      *job = event.snapshot();
      break;
    case v1::WatchJobResponse::kIteration:
      if (event.iteration().iteration() == 1) *job->mutable_initial_iteration() = event.iteration();
      *job->mutable_latest_iteration() = event.iteration();
      // An earlier one of a job that has ended is no news of how far it is.
      if (!Ended(job->state())) job->set_completed_iterations(event.iteration().iteration());
      break;
    case v1::WatchJobResponse::kStateChange:
      ApplyStateChange(event.state_change(), job);
      break;
    default:
      break;
  }
}

WatchStream::WatchStream(const Session& session, Options options, Interrupt& interrupt, WatchSink& sink)
    : session_(session),
      options_(std::move(options)),
      interrupt_(interrupt),
      sink_(sink),
      last_seq_(options_.resume_after_seq),
      reconnect_(options_.reconnect_s, interrupt, [&sink](const std::string& note) { sink.OnNote(note); }) {}

grpc::Status WatchStream::Run() {
  while (true) {
    grpc::Status status = ReadOnce();
    if (end_seen_ || (status.ok() && Ended(job_.state()))) return grpc::Status::OK;
    if (interrupt_.requested()) return {grpc::StatusCode::CANCELLED, "interrupted"};
    if (!IsTransportLoss(status.error_code()) || snapshot_seq_ < 0 || !reconnect_.Await(status)) {
      if (interrupt_.requested()) return {grpc::StatusCode::CANCELLED, "interrupted"};
      if (!status.ok()) return status;
      return {grpc::StatusCode::UNAVAILABLE, "the stream ended before the job did"};
    }
  }
}

grpc::Status WatchStream::ReadOnce() {
  v1::WatchJobRequest request;
  request.set_name(options_.job);
  request.set_resume_after_seq(last_seq_);
  request.set_delivery(options_.delivery);
  request.set_max_iterations_per_message(kIterationsPerMessage);
  grpc::ClientContext context;
  const std::unique_ptr<grpc::ClientReader<v1::WatchJobResponse>> reader =
      session_.tuning().WatchJob(&context, request);
  interrupt_.Attach(&context);
  v1::WatchJobResponse message;
  while (reader->Read(&message)) OnMessage(message);
  grpc::Status status = reader->Finish();
  interrupt_.Attach(nullptr);
  return status;
}

void WatchStream::OnMessage(const v1::WatchJobResponse& message) {
  reconnect_.Connected();
  if (message.has_snapshot()) return OnSnapshot(message);
  if (!message.has_iteration_batch()) return OnEvent(message);
  v1::WatchJobResponse event;
  event.set_seq(message.seq() - message.iteration_batch().iterations_size());
  for (const v1::Iteration& iteration : message.iteration_batch().iterations()) {
    event.set_seq(event.seq() + 1);
    *event.mutable_iteration() = iteration;
    OnEvent(event);
  }
}

void WatchStream::OnEvent(const v1::WatchJobResponse& event) {
  if (event.seq() <= last_seq_) return;  // seen before the connection was lost
  last_seq_ = event.seq();
  ApplyEvent(event, &job_);
  sink_.OnEvent(event, job_);
  if (!event.has_state_change()) return;
  end_seen_ = Ended(event.state_change().state());
  if (event.seq() > snapshot_seq_) NotePause();
}

void WatchStream::OnSnapshot(const v1::WatchJobResponse& message) {
  const bool first = snapshot_seq_ < 0;
  snapshot_seq_ = message.seq();
  // A snapshot is no event: what led to it is still to come, except where only new events were asked for.
  if (last_seq_ < 0) last_seq_ = message.seq();
  ApplyEvent(message, &job_);
  if (!first) return;
  sink_.OnEvent(message, job_);
  NotePause();
}

void WatchStream::NotePause() {
  if (job_.state() != v1::JOB_STATE_PAUSED) return;
  sink_.OnNote(absl::StrCat(options_.job, " is paused; waiting (`orbitune", session_.ServerFlag(), " resume ",
                            options_.job, "` lets it go on)"));
}

}  // namespace orbitune::cli
