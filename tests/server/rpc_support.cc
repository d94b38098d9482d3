#include "tests/server/rpc_support.h"

#include <chrono>
#include <thread>

#include "google/rpc/error_info.pb.h"
#include "google/rpc/status.pb.h"
#include "server/convert/orbit.h"

namespace orbitune::server_test {

v1::Scenario SmallDefinition(int iterations) {
  v1::Scenario definition;
  ToProto(SmallScenario(iterations), &definition);
  return definition;
}

v1::CreateJobRequest CreateRequest(int iterations) {
  v1::CreateJobRequest request;
  *request.mutable_job()->mutable_scenario_definition() = SmallDefinition(iterations);
  return request;
}

ErrorDetails DetailsOf(const grpc::Status& status) {
  ErrorDetails details;
  google::rpc::Status packed;
  EXPECT_TRUE(packed.ParseFromString(status.error_details()));
  if (!status.error_details().empty()) {
    EXPECT_EQ(packed.code(), static_cast<int>(status.error_code()));
    EXPECT_EQ(packed.message(), status.error_message());
  }
  for (const auto& any : packed.details()) {
    google::rpc::BadRequest bad_request;
    google::rpc::ErrorInfo info;
    if (any.UnpackTo(&bad_request)) {
      details.violations.assign(bad_request.field_violations().begin(), bad_request.field_violations().end());
    } else if (any.UnpackTo(&info)) {
      details.reason = info.reason();
      details.domain = info.domain();
    } else {
      details.retry = details.retry || any.Is<google::rpc::RetryInfo>();
    }
  }
  return details;
}

Client::Client(const std::string& address, const grpc::ChannelArguments& arguments) {
  grpc::ChannelArguments own = arguments;
  own.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  channel_ = grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), own);
  tuning_ = v1::TuningService::NewStub(channel_);
  scenarios_ = v1::ScenarioService::NewStub(channel_);
  simulation_ = v1::SimulationService::NewStub(channel_);
}

grpc::Status Client::Create(const v1::CreateJobRequest& request, v1::Job* job) {
  grpc::ClientContext context;
  v1::Job ignored;
  return tuning_->CreateJob(&context, request, job == nullptr ? &ignored : job);
}

std::string Client::Create(int iterations) {
  v1::Job job;
  const grpc::Status status = Create(CreateRequest(iterations), &job);
  EXPECT_TRUE(status.ok()) << status.error_message();
  return job.name();
}

grpc::Status Client::Get(const std::string& name, v1::Job* job) {
  grpc::ClientContext context;
  v1::GetJobRequest request;
  request.set_name(name);
  return tuning_->GetJob(&context, request, job);
}

v1::Job Client::Get(const std::string& name) {
  v1::Job job;
  const grpc::Status status = Get(name, &job);
  EXPECT_TRUE(status.ok()) << name << ": " << status.error_message();
  return job;
}

grpc::Status Client::Delete(const std::string& name) {
  grpc::ClientContext context;
  v1::DeleteJobRequest request;
  request.set_name(name);
  google::protobuf::Empty response;
  return tuning_->DeleteJob(&context, request, &response);
}

v1::ListIterationsResponse Client::Iterations(const std::string& name) {
  v1::ListIterationsResponse all;
  v1::ListIterationsRequest request;
  request.set_parent(name);
  do {
    grpc::ClientContext context;
    v1::ListIterationsResponse page;
    const grpc::Status status = tuning_->ListIterations(&context, request, &page);
    EXPECT_TRUE(status.ok()) << name << ": " << status.error_message();
    request.set_page_token(page.next_page_token());
    page.clear_next_page_token();
    all.MergeFrom(page);
  } while (!request.page_token().empty());
  return all;
}

v1::Job Client::WaitForEnd(const std::string& name) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(3);
  while (true) {
    const v1::Job job = Get(name);
    if (job.name().empty() || HasEnded(job.state())) return job;
    if (std::chrono::steady_clock::now() > deadline) {
      ADD_FAILURE() << name << " hangs";
      return job;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
}

void Client::WaitForIterations(const std::string& name, int completed) {
  Watch watch(*this, name);
  v1::WatchJobResponse event;
  while (watch.Read(&event)) {
    if (event.snapshot().completed_iterations() >= completed || event.iteration().iteration() >= completed) return;
  }
  ADD_FAILURE() << name << " ended before iteration " << completed;
}

Watch::Watch(Client& client, const std::string& name, std::int64_t resume_after_seq, v1::Delivery delivery,
             int max_iterations_per_message) {
  v1::WatchJobRequest request;
  request.set_name(name);
  request.set_resume_after_seq(resume_after_seq);
  request.set_delivery(delivery);
  request.set_max_iterations_per_message(max_iterations_per_message);
  context_.set_deadline(std::chrono::system_clock::now() + std::chrono::minutes(1));
  reader_ = client.tuning().WatchJob(&context_, request);
}

Watch::~Watch() {
  if (finished_) return;
  Cancel();
  v1::WatchJobResponse ignored;
  while (Read(&ignored)) {
  }
  reader_->Finish();
}

std::vector<v1::WatchJobResponse> Watch::ReadAll(grpc::Status* status) {
  std::vector<v1::WatchJobResponse> events;
  v1::WatchJobResponse event;
  while (Read(&event)) events.push_back(event);
  *status = Finish();
  return events;
}

grpc::Status Watch::Finish() {
  finished_ = true;
  return reader_->Finish();
}

std::unique_ptr<RpcServer> StartRpcServer(Api& api) {
  auto server = RpcServer::Start("127.0.0.1:0", api);
  EXPECT_TRUE(server.ok()) << server.status();
  return *std::move(server);
}

RpcServerTest::RpcServerTest(const ApiLimits& limits)
    : api_(engine_.use_cases(), engine_.campaigns(), engine_.gains(), nullptr, limits) {}

}  // namespace orbitune::server_test
