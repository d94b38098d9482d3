#include "client/cli/connection.h"

#include <sys/stat.h>

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/files.h"
#include "grpcpp/create_channel.h"
#include "grpcpp/security/credentials.h"
#include "grpcpp/support/channel_arguments.h"
#include "grpcpp/support/client_interceptor.h"

namespace orbitune::cli {
namespace {

// Calls that may be sent twice without harm: reads, and what comes to the same when it is sent again.
constexpr char kServiceConfig[] = R"({"methodConfig": [{
  "name": [
    {"service": "orbitune.v1.AccessService"},
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

constexpr std::string_view kHttps = "https://";

// Adds the token to every call, under TLS and in the clear alike; gRPC's own credentials know only the former.
class TokenSender final : public grpc::experimental::Interceptor {
 public:
  explicit TokenSender(const std::string& header) : header_(header) {}
  void Intercept(grpc::experimental::InterceptorBatchMethods* call) override {
    using grpc::experimental::InterceptionHookPoints;
    if (call->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_INITIAL_METADATA)) {
      call->GetSendInitialMetadata()->insert({"authorization", header_});
    }
    call->Proceed();
  }

 private:
  const std::string& header_;
};

class TokenSenders final : public grpc::experimental::ClientInterceptorFactoryInterface {
 public:
  explicit TokenSenders(const std::string& token) : header_(absl::StrCat("Bearer ", token)) {}
  grpc::experimental::Interceptor* CreateClientInterceptor(grpc::experimental::ClientRpcInfo*) override {
    return new TokenSender(header_);
  }

 private:
  const std::string header_;
};

absl::Status OptionError(const std::string& option, std::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(option, ": ", absl::string_view(what.data(), what.size())));
}

// A file that only its owner can read.
absl::StatusOr<std::string> ReadTokenFile(const std::string& path) {
  struct stat about {};
  if (stat(path.c_str(), &about) == 0 && S_ISREG(about.st_mode) && (about.st_mode & (S_IRWXG | S_IRWXO)) != 0) {
    return OptionError(absl::StrCat("--token-file ", path),
                       absl::StrFormat("other users may read or write it (mode %04o): chmod 600 it, and make another "
                                       "token if they are not to be trusted",
                                       about.st_mode & 07777U));
  }
  return ReadTextFile(path);
}

// Empty: none.
absl::StatusOr<std::string> ReadToken(const Globals& globals) {
  std::string source = "ORBITUNE_TOKEN";
  std::string token;
  if (!globals.token_file.empty()) {
    source = absl::StrCat("--token-file ", globals.token_file);
    auto text = ReadTokenFile(globals.token_file);
    if (!text.ok()) return text.status();
    token = *std::move(text);
  } else if (const char* const given = std::getenv("ORBITUNE_TOKEN"); given != nullptr) {
    token = given;
  }
  token = std::string(absl::StripAsciiWhitespace(token));
  const bool is_file = !globals.token_file.empty();
  if ((is_file && token.empty()) || !std::ranges::all_of(token, [](char c) { return c > ' ' && c <= '~'; })) {
    return OptionError(source, "has no token: one begins with orb_ and has no spaces");
  }
  return token;
}

bool IsLoopback(const std::string& server) {
  std::string host = server.substr(0, server.rfind(':'));
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  return host == "localhost" || host == "::1" || host.starts_with("127.") || server.starts_with("unix:");
}

// What a file holds; nothing for no file.
absl::StatusOr<std::string> ReadPem(const std::string& path) {
  return path.empty() ? absl::StatusOr<std::string>(std::string()) : ReadTextFile(path);
}

absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> CredentialsOf(const Globals& globals, bool tls) {
  if (!tls) return grpc::InsecureChannelCredentials();
  grpc::SslCredentialsOptions options;  // without authorities: the system's
  for (const auto& [file, text] :
       {std::pair(&globals.tls_ca, &options.pem_root_certs), std::pair(&globals.tls_cert, &options.pem_cert_chain),
        std::pair(&globals.tls_key, &options.pem_private_key)}) {
    auto pem = ReadPem(*file);
    if (!pem.ok()) return pem.status();
    *text = *std::move(pem);
  }
  return grpc::SslCredentials(options);
}

}  // namespace

absl::StatusOr<std::shared_ptr<grpc::Channel>> Connect(const Globals& globals) {
  const bool tls = globals.server.starts_with(kHttps) || !globals.tls_ca.empty() || !globals.tls_cert.empty();
  const std::string server = globals.server.starts_with(kHttps) ? globals.server.substr(kHttps.size()) : globals.server;
  const auto token = ReadToken(globals);
  if (!token.ok()) return token.status();
  if (!token->empty() && !tls && !globals.insecure && !IsLoopback(server)) {
    return OptionError(
        absl::StrCat("--server ", globals.server),
        "the token would cross the network in the clear: say https://HOST:PORT, and --tls-ca FILE for an "
        "authority of one's own; or --insecure");
  }
  const auto credentials = CredentialsOf(globals, tls);
  if (!credentials.ok()) return credentials.status();
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
  std::vector<std::unique_ptr<grpc::experimental::ClientInterceptorFactoryInterface>> senders;
  if (!token->empty()) senders.push_back(std::make_unique<TokenSenders>(*token));
  return grpc::experimental::CreateCustomChannelWithInterceptors(server, *credentials, arguments, std::move(senders));
}

}  // namespace orbitune::cli
