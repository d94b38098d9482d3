// Errors as users meet them: the text on stderr and the exit code.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "grpcpp/support/status.h"

namespace orbitune::cli {

inline constexpr int kExitOk = 0;
inline constexpr int kExitUnsuccessful = 1;  // the job or the episode did not end well
inline constexpr int kExitUsage = 2;
inline constexpr int kExitNotFound = 3;
inline constexpr int kExitUnreachable = 4;
inline constexpr int kExitRefused = 5;
inline constexpr int kExitServerError = 6;
inline constexpr int kExitNotAllowed = 7;
inline constexpr int kExitInterrupted = 130;

int ExitCodeFor(grpc::StatusCode code);

// The codes of the two libraries have the same numbers.
grpc::Status ToGrpcStatus(const absl::Status& status);

// "NOT_FOUND".
std::string CodeName(grpc::StatusCode code);

// `orbitune: CODE: message`, and a line for each detail: violated fields, when to try again.
// In JSON: one line, {"error": {...}}. Ends with a line end.
std::string RenderError(const grpc::Status& status, bool json);

}  // namespace orbitune::cli
