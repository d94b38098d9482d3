// What the tests over gRPC share: a server with an engine behind it, and calls that say in one line what came back.
#pragma once

#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "google/rpc/error_details.pb.h"
#include "orbitune/v1/scenario.grpc.pb.h"
#include "orbitune/v1/simulation.grpc.pb.h"
#include "orbitune/v1/tuning.grpc.pb.h"
#include "server/rpc/server.h"
#include "tests/server/engine_support.h"

namespace orbitune::server_test {

// SmallScenario (engine_support.h) as a client sends it.
v1::Scenario SmallDefinition(int iterations);
v1::CreateJobRequest CreateRequest(int iterations);

struct ErrorDetails {
  std::vector<google::rpc::BadRequest::FieldViolation> violations;
  std::string reason;  // ErrorInfo's
  std::string domain;
  bool retry = false;
};
ErrorDetails DetailsOf(const grpc::Status& status);

// The stubs of a server; every call waits for its answer.
class Client {
 public:
  // Every client has a connection of its own.
  explicit Client(const std::string& address, const grpc::ChannelArguments& arguments = {});

  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }
  v1::TuningService::Stub& tuning() { return *tuning_; }
  v1::ScenarioService::Stub& scenarios() { return *scenarios_; }
  v1::SimulationService::Stub& simulation() { return *simulation_; }

  grpc::Status Create(const v1::CreateJobRequest& request, v1::Job* job = nullptr);
  // The name; fails the test where the answer is an error.
  std::string Create(int iterations);
  grpc::Status Get(const std::string& name, v1::Job* job);
  v1::Job Get(const std::string& name);
  template <typename Request>
  grpc::Status Transition(grpc::Status (v1::TuningService::Stub::*method)(grpc::ClientContext*, const Request&,
                                                                          v1::Job*),
                          const std::string& name) {
    grpc::ClientContext context;
    Request request;
    request.set_name(name);
    v1::Job job;
    return (*tuning_.*method)(&context, request, &job);
  }
  grpc::Status Cancel(const std::string& name) { return Transition(&v1::TuningService::Stub::CancelJob, name); }
  grpc::Status Delete(const std::string& name);
  // All pages in one message; fails the test where an answer is an error.
  v1::ListIterationsResponse Iterations(const std::string& name);

  // Polls; fails the test where it takes minutes, or the server is gone.
  v1::Job WaitForEnd(const std::string& name);
  void WaitForIterations(const std::string& name, int completed);

 private:
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::TuningService::Stub> tuning_;
  std::unique_ptr<v1::ScenarioService::Stub> scenarios_;
  std::unique_ptr<v1::SimulationService::Stub> simulation_;
};

inline bool HasEnded(v1::JobState state) { return state >= v1::JOB_STATE_SUCCEEDED; }

// A WatchJob call.
class Watch {
 public:
  Watch(Client& client, const std::string& name, std::int64_t resume_after_seq = 0,
        v1::Delivery delivery = v1::DELIVERY_EVERY, int max_iterations_per_message = 0);
  ~Watch();

  // False at the end.
  bool Read(v1::WatchJobResponse* event) { return reader_->Read(event); }
  // Everything up to the end, whose status `status` is then.
  std::vector<v1::WatchJobResponse> ReadAll(grpc::Status* status);
  void Cancel() { context_.TryCancel(); }
  grpc::Status Finish();

 private:
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReader<v1::WatchJobResponse>> reader_;
  bool finished_ = false;
};

// At any free port; fails the test where it cannot.
std::unique_ptr<RpcServer> StartRpcServer(Api& api);

// For a test of the RPCs: an engine, a server for it in this process, and a client.
class RpcServerTest : public testing::Test {
 protected:
  explicit RpcServerTest(const ApiLimits& limits = {});
  ~RpcServerTest() override { server_->Shutdown(std::chrono::seconds(2)); }

  TemporaryDirectory directory_;
  Engine engine_{directory_.File("jobs.db")};
  Api api_;
  const std::unique_ptr<RpcServer> server_ = StartRpcServer(api_);
  const std::unique_ptr<Client> client_ = std::make_unique<Client>(server_->address());
};

// For a test of one service, such as v1::GainService.
template <typename Service>
class RpcServiceTest : public RpcServerTest {
 protected:
  using Stub = typename Service::Stub;

  template <typename Request, typename Response>
  grpc::Status Call(grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                    const Request& request, Response* response) {
    grpc::ClientContext context;
    return (*stub_.*method)(&context, request, response);
  }

  const std::unique_ptr<Stub> stub_ = Service::NewStub(client_->channel());
};

}  // namespace orbitune::server_test
