// absl::Status as every transport tells it: google.rpc.Status with BadRequest, ErrorInfo and RetryInfo.
#pragma once

#include "absl/status/status.h"
#include "google/rpc/status.pb.h"

namespace orbitune {

// Shortened where it would be too long for a client.
google::rpc::Status ToRpcStatus(const absl::Status& status);

}  // namespace orbitune
