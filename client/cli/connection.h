// The way to the server: in the clear or under TLS, and the token that every call carries.
#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "client/cli/app.h"
#include "grpcpp/channel.h"

namespace orbitune::cli {

// Connects at the first call. The token is that of --token-file, else of ORBITUNE_TOKEN, else none. INVALID_ARGUMENT
// for a file that cannot be used, that others can read, and where a token would cross a network in the clear; the token
// itself is in no error.
absl::StatusOr<std::shared_ptr<grpc::Channel>> Connect(const Globals& globals);

}  // namespace orbitune::cli
