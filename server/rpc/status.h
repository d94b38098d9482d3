// absl::Status to grpc::Status, with google.rpc details: BadRequest, ErrorInfo, RetryInfo.
#pragma once

#include <grpcpp/support/status.h>

#include "absl/status/status.h"

namespace orbitune {

grpc::Status ToGrpc(const absl::Status& status);

}  // namespace orbitune
