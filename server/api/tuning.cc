#include "server/api/tuning.h"

#include "core/base/status.h"
#include "server/api/answer.h"
#include "server/api/verify_feed.h"
#include "server/convert/job.h"

namespace orbitune {
namespace {

absl::StatusOr<std::string> JobId(const std::string& name, std::string_view field = "name") {
  return IdFromName("jobs", name, field);
}

}  // namespace

void TuningApi::AddTo(MethodTable& methods) {
  const std::string service = "orbitune.v1.TuningService.";
  methods.Add(service + "CreateJob", Work::kWrite, this, &TuningApi::CreateJob);
  methods.Add(service + "GetJob", Work::kRead, this, &TuningApi::GetJob);
  methods.Add(service + "ListJobs", Work::kRead, this, &TuningApi::ListJobs);
  methods.Add(service + "CancelJob", Work::kWrite, this, &TuningApi::CancelJob);
  methods.Add(service + "PauseJob", Work::kWrite, this, &TuningApi::PauseJob);
  methods.Add(service + "ResumeJob", Work::kWrite, this, &TuningApi::ResumeJob);
  methods.Add(service + "DeleteJob", Work::kWrite, this, &TuningApi::DeleteJob);
  methods.AddStream<v1::WatchJobResponse>(service + "WatchJob", this, &TuningApi::WatchJob);
  methods.AddStream<v1::VerifyJobResponse>(service + "VerifyJob", this, &TuningApi::VerifyJob);
  methods.Add(service + "ListIterations", Work::kRead, this, &TuningApi::ListIterations);
}

absl::Status TuningApi::CreateJob(const v1::CreateJobRequest& request, v1::Job* out, const CallContext& context) {
  auto job = FromProto(request.job());
  if (!job.ok()) return job.status();
  job->owner = context.caller.owner();
  job->peer = context.caller.peer;
  return Answer(use_cases_.CreateJob(*job, request.request_id(), request.validate_only()), out);
}

absl::Status TuningApi::GetJob(const v1::GetJobRequest& request, v1::Job* out) {
  const auto id = JobId(request.name());
  return id.ok() ? Answer(use_cases_.GetJob(*id), out) : id.status();
}

absl::Status TuningApi::ListJobs(const v1::ListJobsRequest& request, v1::ListJobsResponse* out) {
  const auto page =
      use_cases_.ListJobs(request.page_size(), request.page_token(), request.filter(), request.order_by());
  return AnswerPage(page, out, [out] { return out->add_jobs(); });
}

absl::Status TuningApi::CancelJob(const v1::CancelJobRequest& request, v1::Job* out) {
  const auto id = JobId(request.name());
  return id.ok() ? Answer(use_cases_.CancelJob(*id, request.etag()), out) : id.status();
}

absl::Status TuningApi::PauseJob(const v1::PauseJobRequest& request, v1::Job* out) {
  const auto id = JobId(request.name());
  return id.ok() ? Answer(use_cases_.PauseJob(*id, request.etag()), out) : id.status();
}

absl::Status TuningApi::ResumeJob(const v1::ResumeJobRequest& request, v1::Job* out) {
  const auto id = JobId(request.name());
  return id.ok() ? Answer(use_cases_.ResumeJob(*id, request.etag()), out) : id.status();
}

absl::Status TuningApi::DeleteJob(const v1::DeleteJobRequest& request, google::protobuf::Empty*) {
  const auto id = JobId(request.name());
  return id.ok() ? use_cases_.DeleteJob(*id, request.etag()) : id.status();
}

std::shared_ptr<Feed> TuningApi::WatchJob(const v1::WatchJobRequest& request) { return NewJobFeed(request, context_); }

std::shared_ptr<Feed> TuningApi::VerifyJob(const v1::VerifyJobRequest& request, const CallContext& context) {
  return NewVerifyFeed(request, context.caller, context_);
}

absl::Status TuningApi::ListIterations(const v1::ListIterationsRequest& request, v1::ListIterationsResponse* out) {
  const auto id = JobId(request.parent(), "parent");
  if (!id.ok()) return id.status();
  if (request.max_points() != 0 && (request.page_size() != 0 || !request.page_token().empty())) {
    return InvalidField("max_points", "0 where page_size or page_token is set", request.max_points());
  }
  if (request.max_points() == 0 && (request.first_iteration() != 0 || request.last_iteration() != 0)) {
    return InvalidField("max_points", "in [16, 10000] where first_iteration or last_iteration is set", 0);
  }
  const auto page =
      request.max_points() != 0
          ? use_cases_.SampleIterations(*id, request.max_points(), request.first_iteration(), request.last_iteration())
          : use_cases_.ListIterations(*id, request.page_size(), request.page_token());
  return AnswerPage(page, out, [out] { return out->add_iterations(); });
}

}  // namespace orbitune
