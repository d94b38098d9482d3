#include "server/rest/error.h"

#include "absl/strings/str_cat.h"
#include "server/api/error.h"
#include "server/api/json.h"

namespace orbitune::rest {

int HttpCodeOf(absl::StatusCode code) {
  switch (code) {
    case absl::StatusCode::kOk:
      return 200;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kOutOfRange:
      return 400;
    case absl::StatusCode::kUnauthenticated:
      return 401;
    case absl::StatusCode::kPermissionDenied:
      return 403;
    case absl::StatusCode::kNotFound:
      return 404;
    case absl::StatusCode::kAlreadyExists:
    case absl::StatusCode::kAborted:
      return 409;
    case absl::StatusCode::kResourceExhausted:
      return 429;
    case absl::StatusCode::kCancelled:
      return 499;
    case absl::StatusCode::kUnimplemented:
      return 501;
    case absl::StatusCode::kUnavailable:
      return 503;
    case absl::StatusCode::kDeadlineExceeded:
      return 504;
    default:
      return 500;
  }
}

std::string ErrorJson(const absl::Status& status, int http_code) {
  const google::rpc::Status rpc = ToRpcStatus(status);
  std::string json = absl::StrCat("{\"error\":{\"code\":", http_code == 0 ? HttpCodeOf(status.code()) : http_code,
                                  ",\"status\":\"", absl::StatusCodeToString(status.code()),
                                  "\",\"message\":", QuoteJson(rpc.message()), ",\"details\":[");
  for (int i = 0; i < rpc.details_size(); ++i) absl::StrAppend(&json, i == 0 ? "" : ",", ToJson(rpc.details(i)));
  return json += "]}}";
}

HttpReply ErrorReply(const absl::Status& status, int http_code) {
  HttpReply reply{.code = http_code == 0 ? HttpCodeOf(status.code()) : http_code, .headers = {}, .body = {}};
  reply.body = ErrorJson(status, http_code) + "\n";
  reply.headers.emplace_back("Content-Type", "application/json");
  if (absl::IsUnavailable(status) || absl::IsResourceExhausted(status)) reply.headers.emplace_back("Retry-After", "1");
  return reply;
}

}  // namespace orbitune::rest
