#include "server/rpc/server.h"

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
  explicit Tuning(Api& api) : ApiService(api) {}
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
  Reactor* ListIterations(Context* context, const v1::ListIterationsRequest* request,
                          v1::ListIterationsResponse* out) override {
    return Call("ListIterations", context, request, out);
  }
};

class Campaigns final : public ApiService<v1::CampaignService> {
 public:
  explicit Campaigns(Api& api) : ApiService(api) {}
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
  explicit Scenarios(Api& api) : ApiService(api) {}
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
  explicit Simulation(Api& api) : ApiService(api) {}
  Reactor* SimulateEpisode(Context* context, const v1::SimulateEpisodeRequest* request,
                           v1::SimulateEpisodeResponse* out) override {
    return Call("SimulateEpisode", context, request, out);
  }
};

class GainsService final : public ApiService<v1::GainService> {
 public:
  explicit GainsService(Api& api) : ApiService(api) {}
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
  explicit AccessService(Api& api) : ApiService(api) {}
  Reactor* GetCaller(Context* context, const v1::GetCallerRequest* request, v1::Caller* out) override {
    return Call("GetCaller", context, request, out);
  }
  Reactor* ListAuditEntries(Context* context, const v1::ListAuditEntriesRequest* request,
                            v1::ListAuditEntriesResponse* out) override {
    return Call("ListAuditEntries", context, request, out);
  }
};

class RpcServerImpl final : public RpcServer {
 public:
  RpcServerImpl(const std::string& address, Api& api, const TlsFiles& tls)
      : api_(api),
        tuning_(api),
        campaigns_(api),
        gains_(api),
        scenarios_(api),
        simulation_(api),
        access_(api),
        credentials_(ServerCredentialsOf(tls)) {
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
    builder.SetMaxReceiveMessageSize(kLargestRequestBytes);
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
    server_->Shutdown(std::chrono::system_clock::now() + grace);
    server_->Wait();
  }

 private:
  Api& api_;
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

absl::StatusOr<std::unique_ptr<RpcServer>> RpcServer::Start(const std::string& address, Api& api, const TlsFiles& tls) {
  auto server = std::make_unique<RpcServerImpl>(address, api, tls);
  if (!server->listening()) {
    return absl::UnavailableError(absl::StrCat("cannot listen on ", FormatReceived(address),
                                               ": the address is wrong, not this machine's, or in use"));
  }
  return server;
}

}  // namespace orbitune
