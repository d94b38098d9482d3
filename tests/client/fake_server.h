// A server for the client's tests: answers what the test puts in, and remembers what it was asked.
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "grpcpp/server.h"
#include "orbitune/v1/scenario.grpc.pb.h"
#include "orbitune/v1/simulation.grpc.pb.h"
#include "orbitune/v1/tuning.grpc.pb.h"

namespace orbitune::cli {

class FakeServer final : public v1::TuningService::Service,
                         public v1::ScenarioService::Service,
                         public v1::SimulationService::Service {
 public:
  using WatchWriter = grpc::ServerWriter<v1::WatchJobResponse>;
  using WatchScript = std::function<grpc::Status(grpc::ServerContext*, WatchWriter*)>;

  FakeServer();
  ~FakeServer() override;

  // One per connection, used up in turn.
  std::deque<WatchScript> watches;
  std::vector<v1::Job> jobs;  // what ListJobs and GetJob know; pages have as many as asked for
  std::vector<v1::Iteration> iterations;
  v1::Scenario scenario;
  v1::SimulateEpisodeResponse episode;
  grpc::Status create_status;
  std::vector<v1::VerifyJobResponse> verification;  // what VerifyJob streams before its status
  grpc::Status verify_status;

  std::vector<v1::WatchJobRequest> watch_requests;
  std::vector<v1::CreateJobRequest> create_requests;
  std::vector<v1::ListJobsRequest> list_requests;
  std::vector<v1::ListIterationsRequest> iteration_requests;
  std::vector<v1::SimulateEpisodeRequest> simulate_requests;
  std::vector<v1::VerifyJobRequest> verify_requests;

  struct Result {
    int code;
    std::string out;
    std::string err;
  };
  // Runs `orbitune` against this server; on a terminal of so many columns if width > 0.
  Result Run(const std::vector<std::string>& arguments, int width = 0) const;

 private:
  grpc::Status CreateJob(grpc::ServerContext*, const v1::CreateJobRequest*, v1::Job*) override;
  grpc::Status GetJob(grpc::ServerContext*, const v1::GetJobRequest*, v1::Job*) override;
  grpc::Status ListJobs(grpc::ServerContext*, const v1::ListJobsRequest*, v1::ListJobsResponse*) override;
  grpc::Status CancelJob(grpc::ServerContext*, const v1::CancelJobRequest*, v1::Job*) override;
  grpc::Status WatchJob(grpc::ServerContext*, const v1::WatchJobRequest*, WatchWriter*) override;
  grpc::Status VerifyJob(grpc::ServerContext*, const v1::VerifyJobRequest*,
                         grpc::ServerWriter<v1::VerifyJobResponse>*) override;
  grpc::Status ListIterations(grpc::ServerContext*, const v1::ListIterationsRequest*,
                              v1::ListIterationsResponse*) override;
  grpc::Status GetScenario(grpc::ServerContext*, const v1::GetScenarioRequest*, v1::Scenario*) override;
  grpc::Status SimulateEpisode(grpc::ServerContext*, const v1::SimulateEpisodeRequest*,
                               v1::SimulateEpisodeResponse*) override;

  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

// `orbitune ARGUMENTS`, as a user types it.
FakeServer::Result RunClient(const std::vector<std::string>& arguments, int width = 0);

}  // namespace orbitune::cli
