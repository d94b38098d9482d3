#include "server/rpc/server.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <exception>

#include "absl/strings/str_cat.h"
#include "grpc/health/v1/health.pb.h"
#include "orbitune/v1/scenario.grpc.pb.h"
#include "orbitune/v1/simulation.grpc.pb.h"
#include "orbitune/v1/tuning.grpc.pb.h"
#include "server/convert/job.h"
#include "server/rpc/executor.h"
#include "server/rpc/status.h"
#include "server/rpc/watch.h"

namespace orbitune {
namespace {

using grpc::CallbackServerContext;
using Reactor = grpc::ServerUnaryReactor;

// Threads for what blocks, by how long it may: neither a disk that hangs nor a long episode keeps a read waiting.
struct Executors {
  Executor reads{4, 10'000};
  Executor writes{4, 10'000};
  Executor episodes{2, 256};
};
// Larger than any sensible request, so that an oversized field is refused by name.
constexpr int kLargestRequest = 16 << 20;

// Runs `handle`, which returns an absl::Status and may block, on the executor, and finishes the call with it.
template <typename Handle>
Reactor* Unary(CallbackServerContext* context, Executor& executor, Handle handle) {
  Reactor* reactor = context->DefaultReactor();
  const bool posted = executor.TryPost([reactor, handle = std::move(handle)] { reactor->Finish(ToGrpc(handle())); });
  if (!posted) reactor->Finish(ToGrpc(absl::ResourceExhaustedError("too many requests are waiting")));
  return reactor;
}

// Writes a StatusOr's value to `out`, or hands back its error.
template <typename T, typename Proto>
absl::Status Answer(const absl::StatusOr<T>& value, Proto* out) {
  if (value.ok()) ToProto(*value, out);
  return value.status();
}

class Tuning final : public v1::TuningService::CallbackService {
 public:
  Tuning(UseCases& use_cases, Executors& executors, Watchers& watchers)
      : use_cases_(use_cases), executors_(executors), watchers_(watchers) {}

  Reactor* CreateJob(CallbackServerContext* context, const v1::CreateJobRequest* request, v1::Job* out) override {
    return Unary(context, executors_.writes, [this, request, out]() -> absl::Status {
      const auto job = FromProto(request->job());
      if (!job.ok()) return job.status();
      return Answer(use_cases_.CreateJob(*job, request->request_id(), request->validate_only()), out);
    });
  }

  Reactor* GetJob(CallbackServerContext* context, const v1::GetJobRequest* request, v1::Job* out) override {
    return ForJob(context, executors_.reads, request->name(),
                  [this, out](const std::string& id) { return Answer(use_cases_.GetJob(id), out); });
  }

  Reactor* ListJobs(CallbackServerContext* context, const v1::ListJobsRequest* request,
                    v1::ListJobsResponse* out) override {
    return Unary(context, executors_.reads, [this, request, out]() -> absl::Status {
      const auto page =
          use_cases_.ListJobs(request->page_size(), request->page_token(), request->filter(), request->order_by());
      if (!page.ok()) return page.status();
      for (const JobRecord& job : page->items) ToProto(job, out->add_jobs());
      out->set_next_page_token(page->next_page_token);
      return absl::OkStatus();
    });
  }

  Reactor* CancelJob(CallbackServerContext* context, const v1::CancelJobRequest* request, v1::Job* out) override {
    return ForJob(context, executors_.writes, request->name(), [this, request, out](const std::string& id) {
      return Answer(use_cases_.CancelJob(id, request->etag()), out);
    });
  }

  Reactor* PauseJob(CallbackServerContext* context, const v1::PauseJobRequest* request, v1::Job* out) override {
    return ForJob(context, executors_.writes, request->name(), [this, request, out](const std::string& id) {
      return Answer(use_cases_.PauseJob(id, request->etag()), out);
    });
  }

  Reactor* ResumeJob(CallbackServerContext* context, const v1::ResumeJobRequest* request, v1::Job* out) override {
    return ForJob(context, executors_.writes, request->name(), [this, request, out](const std::string& id) {
      return Answer(use_cases_.ResumeJob(id, request->etag()), out);
    });
  }

  Reactor* DeleteJob(CallbackServerContext* context, const v1::DeleteJobRequest* request,
                     google::protobuf::Empty*) override {
    return ForJob(context, executors_.writes, request->name(),
                  [this, request](const std::string& id) { return use_cases_.DeleteJob(id, request->etag()); });
  }

  grpc::ServerWriteReactor<v1::WatchJobResponse>* WatchJob(CallbackServerContext*,
                                                           const v1::WatchJobRequest* request) override {
    return StartWatch(*request, use_cases_, executors_.reads, watchers_);
  }

  Reactor* ListIterations(CallbackServerContext* context, const v1::ListIterationsRequest* request,
                          v1::ListIterationsResponse* out) override {
    return Unary(context, executors_.reads, [this, request, out]() -> absl::Status {
      const auto id = IdFromName("jobs", request->parent(), "parent");
      if (!id.ok()) return id.status();
      const auto page = use_cases_.ListIterations(*id, request->page_size(), request->page_token());
      if (!page.ok()) return page.status();
      for (const IterationRecord& record : page->items) ToProto(record, out->add_iterations());
      out->set_next_page_token(page->next_page_token);
      return absl::OkStatus();
    });
  }

 private:
  template <typename Handle>
  Reactor* ForJob(CallbackServerContext* context, Executor& executor, const std::string& name, Handle handle) {
    return Unary(context, executor, [&name, handle = std::move(handle)]() -> absl::Status {
      const auto id = IdFromName("jobs", name, "name");
      return id.ok() ? handle(*id) : id.status();
    });
  }

  UseCases& use_cases_;
  Executors& executors_;
  Watchers& watchers_;
};

class Scenarios final : public v1::ScenarioService::CallbackService {
 public:
  Scenarios(UseCases& use_cases, Executor& executor) : use_cases_(use_cases), executor_(executor) {}

  Reactor* ListScenarios(CallbackServerContext* context, const v1::ListScenariosRequest* request,
                         v1::ListScenariosResponse* out) override {
    return Unary(context, executor_, [this, request, out]() -> absl::Status {
      const auto page = use_cases_.ListScenarios(request->page_size(), request->page_token());
      if (!page.ok()) return page.status();
      for (const Scenario& scenario : page->items) ToProto(scenario, out->add_scenarios());
      out->set_next_page_token(page->next_page_token);
      return absl::OkStatus();
    });
  }

  Reactor* GetScenario(CallbackServerContext* context, const v1::GetScenarioRequest* request,
                       v1::Scenario* out) override {
    return Unary(context, executor_, [this, request, out]() -> absl::Status {
      const auto id = IdFromName("scenarios", request->name(), "name");
      return id.ok() ? Answer(use_cases_.GetScenario(*id), out) : id.status();
    });
  }

 private:
  UseCases& use_cases_;
  Executor& executor_;
};

class Simulation final : public v1::SimulationService::CallbackService {
 public:
  Simulation(UseCases& use_cases, Executor& executor) : use_cases_(use_cases), executor_(executor) {}

  Reactor* SimulateEpisode(CallbackServerContext* context, const v1::SimulateEpisodeRequest* request,
                           v1::SimulateEpisodeResponse* out) override {
    return Unary(context, executor_, [this, context, request, out]() -> absl::Status {
      const auto cancelled = [context] { return context->IsCancelled(); };
      if (cancelled()) return absl::CancelledError("nobody waits for the episode any more");
      const auto episode = FromProto(*request);
      return episode.ok() ? Answer(use_cases_.SimulateEpisode(*episode, cancelled), out) : episode.status();
    });
  }

 private:
  UseCases& use_cases_;
  Executor& executor_;
};

class RpcServerImpl final : public RpcServer {
 public:
  RpcServerImpl(const std::string& address, UseCases& use_cases)
      : tuning_(use_cases, executors_, watchers_),
        scenarios_(use_cases, executors_.reads),
        simulation_(use_cases, executors_.episodes) {
    grpc::EnableDefaultHealthCheckService(true);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
    // Reflection describes grpc.health.v1 only if its descriptor is linked in.
    grpc::health::v1::HealthCheckRequest::descriptor();
    grpc::ServerBuilder builder;
    builder.AddListeningPort(address, grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(&tuning_);
    builder.RegisterService(&scenarios_);
    builder.RegisterService(&simulation_);
    builder.SetMaxReceiveMessageSize(kLargestRequest);
    builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, 30'000);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 20'000);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
    builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 10'000);
    server_ = builder.BuildAndStart();
    if (server_ == nullptr) return;
    SetServing(true);
    address_ = absl::StrCat(address.substr(0, address.rfind(':')), ":", port_);
  }

  bool listening() const { return server_ != nullptr && port_ != 0; }
  const std::string& address() const override { return address_; }

  void SetServing(bool serving) override {
    server_->GetHealthCheckService()->SetServingStatus(serving);  // of the server as a whole
    for (const char* service : {v1::TuningService::service_full_name(), v1::ScenarioService::service_full_name(),
                                v1::SimulationService::service_full_name()}) {
      server_->GetHealthCheckService()->SetServingStatus(service, serving);
    }
  }

  void Shutdown(std::chrono::milliseconds grace) override {
    server_->GetHealthCheckService()->Shutdown();
    watchers_.Drain();
    server_->Shutdown(std::chrono::system_clock::now() + grace);
    server_->Wait();
  }

 private:
  Watchers watchers_;
  Executors executors_;
  Tuning tuning_;
  Scenarios scenarios_;
  Simulation simulation_;
  std::unique_ptr<grpc::Server> server_;
  int port_ = 0;
  std::string address_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<RpcServer>> RpcServer::Start(const std::string& address, UseCases& use_cases) {
  auto server = std::make_unique<RpcServerImpl>(address, use_cases);
  if (!server->listening()) {
    return absl::UnavailableError(absl::StrCat("cannot listen on ", FormatReceived(address),
                                               ": the address is wrong, not this machine's, or in use"));
  }
  return server;
}

}  // namespace orbitune
