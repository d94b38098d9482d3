#include "server/api/error.h"

#include "absl/strings/str_cat.h"
#include "core/base/status.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/error_info.pb.h"
#include "server/jobs/limit.h"

namespace orbitune {
namespace {

constexpr char kDomain[] = "orbitune";
constexpr int kRetryDelaySeconds = 1;
// A gRPC client refuses trailing metadata of more than 8 KiB, and with it the error: the message goes there twice, the
// details in base 64.
constexpr std::size_t kLongestMessage = 1000;
constexpr std::size_t kLongestViolations = 3000;

std::string Shortened(std::string message) {
  if (message.size() <= kLongestMessage) return message;
  std::size_t end = kLongestMessage;
  while (end > 0 && (static_cast<unsigned char>(message[end]) & 0xc0) == 0x80) --end;  // a whole UTF-8 character
  message.resize(end);
  return message + "...";
}

// As many as there is room for; the last one tells how many more there are.
google::rpc::BadRequest ToBadRequest(const std::vector<FieldViolation>& violations) {
  google::rpc::BadRequest bad_request;
  std::size_t size = 0;
  for (const FieldViolation& violation : violations) {
    auto* v = bad_request.add_field_violations();
    v->set_field(violation.field);
    v->set_description(violation.description);
    size += violation.field.size() + violation.description.size();
    const auto left = violations.size() - static_cast<std::size_t>(bad_request.field_violations_size());
    if (size <= kLongestViolations || left == 0) continue;
    v->set_description(absl::StrCat(violation.description, " (and ", left, " more violations)"));
    break;
  }
  return bad_request;
}

}  // namespace

google::rpc::Status ToRpcStatus(const absl::Status& status) {
  google::rpc::Status details;
  details.set_code(static_cast<int>(status.code()));
  details.set_message(Shortened(std::string(status.message())));
  if (const auto violations = FieldViolationsOf(status); !violations.empty()) {
    details.add_details()->PackFrom(ToBadRequest(violations));
  }
  if (const std::string reason = ReasonOf(status); !reason.empty()) {
    google::rpc::ErrorInfo info;
    info.set_reason(reason);
    info.set_domain(kDomain);
    if (const auto limit = LimitOf(status)) {
      (*info.mutable_metadata())["option"] = limit->option;
      (*info.mutable_metadata())["limit"] = absl::StrCat(limit->value);
    }
    details.add_details()->PackFrom(info);
  }
  if (absl::IsUnavailable(status) || absl::IsResourceExhausted(status)) {
    google::rpc::RetryInfo retry;
    retry.mutable_retry_delay()->set_seconds(kRetryDelaySeconds);
    details.add_details()->PackFrom(retry);
  }
  return details;
}

}  // namespace orbitune
