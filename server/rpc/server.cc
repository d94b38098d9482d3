#include "server/rpc/server.h"

#include <google/protobuf/stubs/logging.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include "absl/strings/str_cat.h"
#include "grpc/health/v1/health.pb.h"
#include "orbitune/v1/audit.grpc.pb.h"
#include "orbitune/v1/campaign.grpc.pb.h"
#include "orbitune/v1/gains.grpc.pb.h"
#include "orbitune/v1/scenario.grpc.pb.h"
#include "orbitune/v1/simulation.grpc.pb.h"
#include "orbitune/v1/tuning.grpc.pb.h"
#include "server/rpc/service.h"

namespace orbitune {
namespace {

class Tuning final : public ApiService<v1::TuningService> {
 public:
  Tuning(Api& api, CallsInFlight& calls) : ApiService(api, calls) {}
  Reactor* CreateJob(Context* context, const v1::CreateJobRequest* request, v1::Job* out) override {
    return Call("CreateJob", context, request, out);
  }
  Reactor* GetJob(Context* context, const v1::GetJobRequest* request, v1::Job* out) override {
    return Call("GetJob", context, request, out);
  }
  Reactor* ListJobs(Context* context, const v1::ListJobsRequest* request, v1::ListJobsResponse* out) override {
    return Call("ListJobs", context, request, out);
  }
  Reactor* CancelJob(Context* context, const v1::CancelJobRequest* request, v1::Job* out) override {
    return Call("CancelJob", context, request, out);
  }
  Reactor* PauseJob(Context* context, const v1::PauseJobRequest* request, v1::Job* out) override {
    return Call("PauseJob", context, request, out);
  }
  Reactor* ResumeJob(Context* context, const v1::ResumeJobRequest* request, v1::Job* out) override {
    return Call("ResumeJob", context, request, out);
  }
  Reactor* DeleteJob(Context* context, const v1::DeleteJobRequest* request, google::protobuf::Empty* out) override {
    return Call("DeleteJob", context, request, out);
  }
  grpc::ServerWriteReactor<v1::WatchJobResponse>* WatchJob(Context* context,
                                                           const v1::WatchJobRequest* request) override {
    return Stream<v1::WatchJobResponse>("WatchJob", context, request);
  }
  grpc::ServerWriteReactor<v1::VerifyJobResponse>* VerifyJob(Context* context,
                                                             const v1::VerifyJobRequest* request) override {
    return Stream<v1::VerifyJobResponse>("VerifyJob", context, request);
  }
  Reactor* ListIterations(Context* context, const v1::ListIterationsRequest* request,
                          v1::ListIterationsResponse* out) override {
    return Call("ListIterations", context, request, out);
  }
};

class Campaigns final : public ApiService<v1::CampaignService> {
 public:
  Campaigns(Api& api, CallsInFlight& calls) : ApiService(api, calls) {}
  Reactor* CreateCampaign(Context* context, const v1::CreateCampaignRequest* request, v1::Campaign* out) override {
    return Call("CreateCampaign", context, request, out);
  }
  Reactor* GetCampaign(Context* context, const v1::GetCampaignRequest* request, v1::Campaign* out) override {
    return Call("GetCampaign", context, request, out);
  }
  Reactor* ListCampaigns(Context* context, const v1::ListCampaignsRequest* request,
                         v1::ListCampaignsResponse* out) override {
    return Call("ListCampaigns", context, request, out);
  }
  Reactor* PauseCampaign(Context* context, const v1::PauseCampaignRequest* request, v1::Campaign* out) override {
    return Call("PauseCampaign", context, request, out);
  }
  Reactor* ResumeCampaign(Context* context, const v1::ResumeCampaignRequest* request, v1::Campaign* out) override {
    return Call("ResumeCampaign", context, request, out);
  }
  Reactor* CancelCampaign(Context* context, const v1::CancelCampaignRequest* request, v1::Campaign* out) override {
    return Call("CancelCampaign", context, request, out);
  }
  Reactor* DeleteCampaign(Context* context, const v1::DeleteCampaignRequest* request,
                          google::protobuf::Empty* out) override {
    return Call("DeleteCampaign", context, request, out);
  }
  Reactor* ExtendCampaign(Context* context, const v1::ExtendCampaignRequest* request, v1::Campaign* out) override {
    return Call("ExtendCampaign", context, request, out);
  }
  grpc::ServerWriteReactor<v1::WatchCampaignResponse>* WatchCampaign(Context* context,
                                                                     const v1::WatchCampaignRequest* request) override {
    return Stream<v1::WatchCampaignResponse>("WatchCampaign", context, request);
  }
  Reactor* ListCampaignMembers(Context* context, const v1::ListCampaignMembersRequest* request,
                               v1::ListCampaignMembersResponse* out) override {
    return Call("ListCampaignMembers", context, request, out);
  }
};

class Scenarios final : public ApiService<v1::ScenarioService> {
 public:
  Scenarios(Api& api, CallsInFlight& calls) : ApiService(api, calls) {}
  Reactor* ListScenarios(Context* context, const v1::ListScenariosRequest* request,
                         v1::ListScenariosResponse* out) override {
    return Call("ListScenarios", context, request, out);
  }
  Reactor* GetScenario(Context* context, const v1::GetScenarioRequest* request, v1::Scenario* out) override {
    return Call("GetScenario", context, request, out);
  }
};

class Simulation final : public ApiService<v1::SimulationService> {
 public:
  Simulation(Api& api, CallsInFlight& calls) : ApiService(api, calls) {}
  Reactor* SimulateEpisode(Context* context, const v1::SimulateEpisodeRequest* request,
                           v1::SimulateEpisodeResponse* out) override {
    return Call("SimulateEpisode", context, request, out);
  }
};

class GainsService final : public ApiService<v1::GainService> {
 public:
  GainsService(Api& api, CallsInFlight& calls) : ApiService(api, calls) {}
  Reactor* QueryGains(Context* context, const v1::QueryGainsRequest* request, v1::QueryGainsResponse* out) override {
    return Call("QueryGains", context, request, out);
  }
  Reactor* GetGainSet(Context* context, const v1::GetGainSetRequest* request, v1::GainSet* out) override {
    return Call("GetGainSet", context, request, out);
  }
  Reactor* ListGainSets(Context* context, const v1::ListGainSetsRequest* request,
                        v1::ListGainSetsResponse* out) override {
    return Call("ListGainSets", context, request, out);
  }
  Reactor* ImportGainSets(Context* context, const v1::ImportGainSetsRequest* request,
                          v1::ImportGainSetsResponse* out) override {
    return Call("ImportGainSets", context, request, out);
  }
  Reactor* DeleteGainSet(Context* context, const v1::DeleteGainSetRequest* request,
                         google::protobuf::Empty* out) override {
    return Call("DeleteGainSet", context, request, out);
  }
};

class AccessService final : public ApiService<v1::AccessService> {
 public:
  AccessService(Api& api, CallsInFlight& calls) : ApiService(api, calls) {}
  Reactor* GetCaller(Context* context, const v1::GetCallerRequest* request, v1::Caller* out) override {
    return Call("GetCaller", context, request, out);
  }
  Reactor* ListAuditEntries(Context* context, const v1::ListAuditEntriesRequest* request,
                            v1::ListAuditEntriesResponse* out) override {
    return Call("ListAuditEntries", context, request, out);
  }
};

// gRPC unpacks a message before it measures it: 16 MiB could become 16 GiB.
void RefuseCompressedRequests(grpc::ServerBuilder& builder) {
  builder.AddChannelArgument(GRPC_ARG_ENABLE_PER_MESSAGE_DECOMPRESSION, 0);
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_DEFLATE, false);
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_GZIP, false);
}

class RpcServerImpl final : public RpcServer {
 public:
  RpcServerImpl(const std::string& address, Api& api, const TlsFiles& tls, const Limits& limits)
      : api_(api),
        tuning_(api, calls_),
        campaigns_(api, calls_),
        gains_(api, calls_),
        scenarios_(api, calls_),
        simulation_(api, calls_),
        access_(api, calls_),
        credentials_(ServerCredentialsOf(tls)) {
    google::protobuf::SetLogHandler(nullptr);  // what a client sends wrong is answered, and does not fill the log
    grpc::EnableDefaultHealthCheckService(true);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
    // Reflection describes grpc.health.v1 only if its descriptor is linked in.
    grpc::health::v1::HealthCheckRequest::descriptor();
    grpc::ServerBuilder builder;
    builder.AddListeningPort(address, credentials_, &port_);
    builder.RegisterService(&tuning_);
    builder.RegisterService(&campaigns_);
    builder.RegisterService(&gains_);
    builder.RegisterService(&scenarios_);
    builder.RegisterService(&simulation_);
    builder.RegisterService(&access_);
    builder.SetMaxReceiveMessageSize(limits.max_request_bytes);
    RefuseCompressedRequests(builder);
    builder.SetResourceQuota(grpc::ResourceQuota("orbitune").Resize(static_cast<std::size_t>(limits.memory_bytes)));
    builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, limits.max_streams_per_connection);
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
    for (const std::string& service : api_.ServiceNames()) {
      server_->GetHealthCheckService()->SetServingStatus(service, serving);
    }
  }

  void Shutdown(std::chrono::milliseconds grace) override {
    server_->GetHealthCheckService()->Shutdown();
    api_.Drain();
    // gRPC itself would wait for every connection to be closed, and there are clients that only look when they call.
    calls_.AwaitNone(grace);
    server_->Shutdown(std::chrono::system_clock::now());
    server_->Wait();
  }

 private:
  Api& api_;
  CallsInFlight calls_;
  Tuning tuning_;
  Campaigns campaigns_;
  GainsService gains_;
  Scenarios scenarios_;
  Simulation simulation_;
  AccessService access_;
  const std::shared_ptr<grpc::ServerCredentials> credentials_;
  std::unique_ptr<grpc::Server> server_;
  int port_ = 0;
  std::string address_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<RpcServer>> RpcServer::Start(const std::string& address, Api& api, const TlsFiles& tls,
                                                            const Limits& limits) {
  auto server = std::make_unique<RpcServerImpl>(address, api, tls, limits);
  if (!server->listening()) {
    return absl::UnavailableError(absl::StrCat("cannot listen on ", FormatReceived(address),
                                               ": the address is wrong, not this machine's, or in use"));
  }
  return server;
}

}  // namespace orbitune
