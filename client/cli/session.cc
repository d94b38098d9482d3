#include "client/cli/session.h"

#include "absl/strings/str_cat.h"
#include "client/cli/errors.h"

namespace orbitune::cli {
Session::Session(const Globals& globals, const Terminal& terminal, const std::shared_ptr<grpc::Channel>& channel)
    : globals_(globals), terminal_(terminal) {
  stubs_ = {v1::TuningService::NewStub(channel),     v1::ScenarioService::NewStub(channel),
            v1::SimulationService::NewStub(channel), v1::CampaignService::NewStub(channel),
            v1::GainService::NewStub(channel),       v1::AccessService::NewStub(channel)};
}

std::string Session::ServerFlag() const {
  return absl::StrCat(globals_.server == kDefaultServer ? "" : absl::StrCat(" --server ", globals_.server),
                      globals_.tls_ca.empty() ? "" : absl::StrCat(" --tls-ca ", globals_.tls_ca),
                      globals_.token_file.empty() ? "" : absl::StrCat(" --token-file ", globals_.token_file));
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
