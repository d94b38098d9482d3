#include "tests/client/fake_server.h"

#include <algorithm>
#include <sstream>

#include "client/cli/app.h"
#include "grpcpp/security/server_credentials.h"
#include "grpcpp/server_builder.h"

namespace orbitune::cli {
namespace {

// The page of `all` that the request asks for; its token is the index of the first.
template <typename Element, typename Request>
std::vector<Element> Page(const std::vector<Element>& all, const Request& request, std::string* next) {
  const std::size_t begin = request.page_token().empty() ? 0 : std::stoul(request.page_token());
  const std::size_t end = std::min(all.size(), begin + static_cast<std::size_t>(request.page_size()));
  if (end < all.size()) *next = std::to_string(end);
  return {all.begin() + static_cast<std::ptrdiff_t>(begin), all.begin() + static_cast<std::ptrdiff_t>(end)};
}

}  // namespace

FakeServer::FakeServer() {
  grpc::ServerBuilder builder;
  builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
  builder.RegisterService(static_cast<v1::TuningService::Service*>(this));
  builder.RegisterService(static_cast<v1::ScenarioService::Service*>(this));
  builder.RegisterService(static_cast<v1::SimulationService::Service*>(this));
  server_ = builder.BuildAndStart();
}

FakeServer::~FakeServer() { server_->Shutdown(); }

FakeServer::Result FakeServer::Run(const std::vector<std::string>& arguments, int width) const {
  std::vector<std::string> all = {"--server", "127.0.0.1:" + std::to_string(port_)};
  all.insert(all.end(), arguments.begin(), arguments.end());
  return RunClient(all, width);
}

FakeServer::Result RunClient(const std::vector<std::string>& arguments, int width) {
  std::ostringstream out, err;
  Terminal terminal{&out, &err, nullptr};
  if (width > 0) terminal.width = [width] { return width; };
  const int code = RunCli(arguments, terminal);
  return {code, out.str(), err.str()};
}

grpc::Status FakeServer::CreateJob(grpc::ServerContext*, const v1::CreateJobRequest* request, v1::Job* job) {
  create_requests.push_back(*request);
  *job = request->job();
  job->set_name("jobs/new");
  job->set_state(v1::JOB_STATE_QUEUED);
  return create_status;
}

grpc::Status FakeServer::GetJob(grpc::ServerContext*, const v1::GetJobRequest* request, v1::Job* job) {
  const auto found =
      std::find_if(jobs.begin(), jobs.end(), [&](const v1::Job& each) { return each.name() == request->name(); });
  if (found == jobs.end()) return {grpc::StatusCode::NOT_FOUND, "no " + request->name()};
  *job = *found;
  return grpc::Status::OK;
}

grpc::Status FakeServer::ListJobs(grpc::ServerContext*, const v1::ListJobsRequest* request,
                                  v1::ListJobsResponse* response) {
  list_requests.push_back(*request);
  for (const v1::Job& job : Page(jobs, *request, response->mutable_next_page_token())) *response->add_jobs() = job;
  return grpc::Status::OK;
}

grpc::Status FakeServer::CancelJob(grpc::ServerContext* context, const v1::CancelJobRequest* request, v1::Job* job) {
  v1::GetJobRequest get;
  get.set_name(request->name());
  const grpc::Status status = GetJob(context, &get, job);
  if (status.ok() && job->state() == v1::JOB_STATE_SUCCEEDED) {
    return {grpc::StatusCode::FAILED_PRECONDITION, request->name() + " has ended"};
  }
  job->set_state(v1::JOB_STATE_CANCELLED);
  return status;
}

grpc::Status FakeServer::WatchJob(grpc::ServerContext* context, const v1::WatchJobRequest* request,
                                  WatchWriter* writer) {
  watch_requests.push_back(*request);
  if (watches.empty()) return {grpc::StatusCode::INTERNAL, "no more scripts"};
  const WatchScript script = watches.front();
  watches.pop_front();
  return script(context, writer);
}

grpc::Status FakeServer::VerifyJob(grpc::ServerContext*, const v1::VerifyJobRequest* request,
                                   grpc::ServerWriter<v1::VerifyJobResponse>* writer) {
  verify_requests.push_back(*request);
  for (const v1::VerifyJobResponse& message : verification) writer->Write(message);
  return verify_status;
}

grpc::Status FakeServer::ListIterations(grpc::ServerContext*, const v1::ListIterationsRequest* request,
                                        v1::ListIterationsResponse* response) {
  iteration_requests.push_back(*request);
  for (const auto& iteration : Page(iterations, *request, response->mutable_next_page_token())) {
    *response->add_iterations() = iteration;
  }
  return grpc::Status::OK;
}

grpc::Status FakeServer::GetScenario(grpc::ServerContext*, const v1::GetScenarioRequest* request,
                                     v1::Scenario* response) {
  if (request->name() != scenario.name()) return {grpc::StatusCode::NOT_FOUND, "no " + request->name()};
  *response = scenario;
  return grpc::Status::OK;
}

grpc::Status FakeServer::SimulateEpisode(grpc::ServerContext*, const v1::SimulateEpisodeRequest* request,
                                         v1::SimulateEpisodeResponse* response) {
  simulate_requests.push_back(*request);
  *response = episode;
  return grpc::Status::OK;
}

}  // namespace orbitune::cli
