#include "client/cli/errors.h"

#include <optional>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/cli/format.h"
#include "client/cli/json.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"

namespace orbitune::cli {
namespace {

struct Details {
  std::vector<google::rpc::BadRequest::FieldViolation> violations;
  std::optional<double> retry_delay_s;
};

Details ParseDetails(const grpc::Status& status) {
  Details details;
  google::rpc::Status packed;
  if (!packed.ParseFromString(status.error_details())) return details;
  for (const google::protobuf::Any& any : packed.details()) {
    google::rpc::BadRequest bad_request;
    google::rpc::RetryInfo retry;
    if (any.UnpackTo(&bad_request)) {
      const auto& violations = bad_request.field_violations();
      details.violations.insert(details.violations.end(), violations.begin(), violations.end());
    } else if (any.UnpackTo(&retry)) {
      const auto& delay = retry.retry_delay();
      details.retry_delay_s = static_cast<double>(delay.seconds()) + 1e-9 * delay.nanos();
    }
  }
  return details;
}

std::string RenderText(const grpc::Status& status, const Details& details) {
  // A message that only lists the violations is not said twice.
  const bool listed = !details.violations.empty() &&
                      absl::StrContains(status.error_message(), details.violations.front().description());
  std::string text = absl::StrCat("orbitune: ", CodeName(status.error_code()), listed ? "" : ": ",
                                  listed ? "" : status.error_message(), "\n");
  for (const auto& violation : details.violations) {
    absl::StrAppend(&text, "  ", violation.field(), ": ", violation.description(), "\n");
  }
  if (details.retry_delay_s) {
    absl::StrAppend(&text, "  try again in ", HumanDuration(*details.retry_delay_s), "\n");
  }
  return text;
}

std::string RenderJson(const grpc::Status& status, const Details& details) {
  std::string text = absl::StrCat("{\"error\":{\"code\":", JsonQuote(CodeName(status.error_code())),
                                  ",\"message\":", JsonQuote(status.error_message()));
  if (!details.violations.empty()) {
    const auto append = [](std::string* out, const google::rpc::BadRequest::FieldViolation& violation) {
      absl::StrAppend(out, "{\"field\":", JsonQuote(violation.field()),
                      ",\"description\":", JsonQuote(violation.description()), "}");
    };
    absl::StrAppend(&text, ",\"field_violations\":[", absl::StrJoin(details.violations, ",", append), "]");
  }
  if (details.retry_delay_s) absl::StrAppend(&text, ",\"retry_delay_s\":", RoundTrip(*details.retry_delay_s));
  absl::StrAppend(&text, "}}\n");
  return text;
}

}  // namespace

int ExitCodeFor(grpc::StatusCode code) {
  switch (code) {
    case grpc::StatusCode::OK:
      return kExitOk;
    case grpc::StatusCode::INVALID_ARGUMENT:
    case grpc::StatusCode::OUT_OF_RANGE:
      return kExitUsage;
    case grpc::StatusCode::NOT_FOUND:
      return kExitNotFound;
    case grpc::StatusCode::UNAVAILABLE:
    case grpc::StatusCode::DEADLINE_EXCEEDED:
      return kExitUnreachable;
    case grpc::StatusCode::FAILED_PRECONDITION:
    case grpc::StatusCode::ALREADY_EXISTS:
    case grpc::StatusCode::ABORTED:
      return kExitRefused;
    case grpc::StatusCode::UNAUTHENTICATED:
    case grpc::StatusCode::PERMISSION_DENIED:
      return kExitNotAllowed;
    default:
      return kExitServerError;
  }
}

grpc::Status ToGrpcStatus(const absl::Status& status) {
  return grpc::Status(static_cast<grpc::StatusCode>(status.raw_code()), std::string(status.message()));
}

std::string CodeName(grpc::StatusCode code) { return absl::StatusCodeToString(static_cast<absl::StatusCode>(code)); }

std::string RenderError(const grpc::Status& status, bool json) {
  const Details details = ParseDetails(status);
  return json ? RenderJson(status, details) : RenderText(status, details);
}

}  // namespace orbitune::cli
