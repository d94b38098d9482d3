#include "client/cli/session.h"

#include "absl/strings/str_cat.h"
#include "client/cli/errors.h"
#include "grpcpp/create_channel.h"
#include "grpcpp/security/credentials.h"
#include "grpcpp/support/channel_arguments.h"

namespace orbitune::cli {
namespace {

// Calls that may be sent twice without harm: reads, and what comes to the same when it is sent again.
constexpr char kServiceConfig[] = R"({"methodConfig": [{
  "name": [
    {"service": "orbitune.v1.ScenarioService"},
    {"service": "orbitune.v1.SimulationService"},
    {"service": "orbitune.v1.TuningService", "method": "CreateJob"},
    {"service": "orbitune.v1.TuningService", "method": "GetJob"},
    {"service": "orbitune.v1.TuningService", "method": "ListJobs"},
    {"service": "orbitune.v1.TuningService", "method": "ListIterations"},
    {"service": "orbitune.v1.CampaignService", "method": "CreateCampaign"},
    {"service": "orbitune.v1.CampaignService", "method": "ExtendCampaign"},
    {"service": "orbitune.v1.CampaignService", "method": "GetCampaign"},
    {"service": "orbitune.v1.CampaignService", "method": "ListCampaigns"},
    {"service": "orbitune.v1.CampaignService", "method": "ListCampaignMembers"},
    {"service": "orbitune.v1.GainService", "method": "QueryGains"},
    {"service": "orbitune.v1.GainService", "method": "GetGainSet"},
    {"service": "orbitune.v1.GainService", "method": "ListGainSets"},
    {"service": "orbitune.v1.GainService", "method": "ImportGainSets"}],
  "retryPolicy": {"maxAttempts": 3, "initialBackoff": "0.2s", "maxBackoff": "1s", "backoffMultiplier": 2,
                  "retryableStatusCodes": ["UNAVAILABLE"]}}]})";

std::shared_ptr<grpc::Channel> Connect(const std::string& server) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(64 << 20);
  arguments.SetServiceConfigJSON(kServiceConfig);
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 200);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 200);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2000);
  // A quiet stream to a host that has vanished: noticed. Servers refuse pings more often than every 5 min.
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 310'000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 20'000);
  return grpc::CreateCustomChannel(server, grpc::InsecureChannelCredentials(), arguments);
}

}  // namespace

Session::Session(const Globals& globals, const Terminal& terminal) : globals_(globals), terminal_(terminal) {
  const std::shared_ptr<grpc::Channel> channel = Connect(globals.server);
  stubs_ = {v1::TuningService::NewStub(channel), v1::ScenarioService::NewStub(channel),
            v1::SimulationService::NewStub(channel), v1::CampaignService::NewStub(channel),
            v1::GainService::NewStub(channel)};
}

std::string Session::ServerFlag() const {
  return globals_.server == kDefaultServer ? "" : absl::StrCat(" --server ", globals_.server);
}

std::chrono::system_clock::time_point Session::Deadline() const {
  return std::chrono::system_clock::now() +
         std::chrono::milliseconds(static_cast<std::int64_t>(1000 * globals_.timeout_s));
}

int Session::Fail(const grpc::Status& status) const {
  out().flush();
  const int code = ExitCodeFor(status.error_code());
  err() << RenderError(status, json());
  if (code == kExitUnreachable && !json()) {
    err() << "  server: " << globals_.server << " (--server or ORBITUNE_SERVER sets another)\n";
  }
  return code;
}

int Session::Fail(const absl::Status& status) const { return Fail(ToGrpcStatus(status)); }

}  // namespace orbitune::cli
