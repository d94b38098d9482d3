// What pausing, resuming, cancelling and deleting have in common, whatever the resource: several names in one command,
// each with its turn whatever became of those before, and a line for each.
#pragma once

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/errors.h"
#include "client/cli/json.h"
#include "client/cli/parse.h"
#include "client/cli/session.h"
#include "google/protobuf/empty.pb.h"

namespace orbitune::cli {

// act(name): grpc::Status. Prints what fails; the exit code of the first that does.
template <typename Act>
int ForEachName(const Session& session, const char* collection, const std::vector<std::string>& given, Act act) {
  int exit_code = kExitOk;
  for (const std::string& name : given) {
    const grpc::Status status = act(ResourceName(collection, name));
    if (status.ok()) continue;
    const int code = session.Fail(status);
    if (exit_code == kExitOk) exit_code = code;
  }
  return exit_code;
}

// print(session, resource): of what it has become.
template <typename Stub, typename Request, typename Resource, typename Print>
grpc::Status Change(const Session& session,
                    grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Resource*),
                    const std::string& name, Print print) {
  Request request;
  request.set_name(name);
  Resource resource;
  const grpc::Status status = session.Call(method, request, &resource);
  if (status.ok()) print(session, resource);
  return status;
}

template <typename Stub, typename Request>
grpc::Status Delete(const Session& session,
                    grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, google::protobuf::Empty*),
                    const std::string& name) {
  return Change(session, method, name, [&name](const Session& s, const google::protobuf::Empty&) {
    s.out() << (s.json() ? absl::StrCat("{\"deleted\":", JsonQuote(name), "}\n") : name + "  deleted\n");
  });
}

}  // namespace orbitune::cli
