// Errors over HTTP: {"error": {"code", "status", "message", "details"}} and the HTTP code that goes with each.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "server/rest/http.h"

namespace orbitune::rest {

// 200, 400, 404, ..., as google.rpc.Code says.
int HttpCodeOf(absl::StatusCode code);

// The body alone, one line. http_code: 0 for the one that the status has.
std::string ErrorJson(const absl::Status& status, int http_code = 0);

// With Retry-After where a retry helps. http_code: where HTTP knows better than the status (405, 413, 415, 431).
HttpReply ErrorReply(const absl::Status& status, int http_code = 0);

}  // namespace orbitune::rest
