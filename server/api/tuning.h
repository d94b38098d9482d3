// TuningService in protobuf, without a transport: decode, call the use case, encode. The methods are as the proto says.
#pragma once

#include "google/protobuf/empty.pb.h"
#include "server/api/job_feed.h"
#include "server/api/methods.h"

namespace orbitune {

// Thread-safe. Unary methods may block.
class TuningApi {
 public:
  // What `context` refers to outlives this.
  explicit TuningApi(const JobFeedContext& context) : context_(context), use_cases_(context.use_cases) {}

  void AddTo(MethodTable& methods);

 private:
  absl::Status CreateJob(const v1::CreateJobRequest& request, v1::Job* out, const CallContext& context);
  absl::Status GetJob(const v1::GetJobRequest& request, v1::Job* out);
  absl::Status ListJobs(const v1::ListJobsRequest& request, v1::ListJobsResponse* out);
  absl::Status CancelJob(const v1::CancelJobRequest& request, v1::Job* out);
  absl::Status PauseJob(const v1::PauseJobRequest& request, v1::Job* out);
  absl::Status ResumeJob(const v1::ResumeJobRequest& request, v1::Job* out);
  absl::Status DeleteJob(const v1::DeleteJobRequest& request, google::protobuf::Empty* out);
  std::shared_ptr<Feed> WatchJob(const v1::WatchJobRequest& request);
  std::shared_ptr<Feed> VerifyJob(const v1::VerifyJobRequest& request, const CallContext& context);
  absl::Status ListIterations(const v1::ListIterationsRequest& request, v1::ListIterationsResponse* out);

  const JobFeedContext context_;
  UseCases& use_cases_;
};

}  // namespace orbitune
