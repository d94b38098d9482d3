#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/errors.h"
#include "client/cli/json.h"
#include "client/cli/session.h"

namespace orbitune::cli {

int RunWhoami(Session& session) {
  v1::Caller caller;
  const grpc::Status status = session.Call(&v1::AccessService::Stub::GetCaller, v1::GetCallerRequest(), &caller);
  if (!status.ok()) return session.Fail(status);
  if (session.json()) {
    session.out() << JsonLine(caller);
    return kExitOk;
  }
  const std::string role = absl::AsciiStrToLower(v1::Role_Name(caller.role())).substr(std::string("role_").size());
  session.out() << caller.name() << ", " << role << (caller.has_token() ? "" : " (the server has no tokens)") << "\n";
  return kExitOk;
}

}  // namespace orbitune::cli
