#include "server/jobs/limit.h"

#include "absl/strings/cord.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "core/base/status.h"

namespace orbitune {
namespace {

constexpr std::string_view kLimitUrl = "orbitune/limit";  // "OPTION=VALUE"

}  // namespace

absl::Status LimitExceeded(std::string_view what, const Limit& limit, std::string_view advice) {
  absl::Status status =
      WithReason(absl::ResourceExhaustedError(absl::StrCat(ToAbsl(what), ": at most ", limit.value, " (the server's --",
                                                           limit.option, "); ", ToAbsl(advice))),
                 "LIMIT_EXCEEDED");
  status.SetPayload(ToAbsl(kLimitUrl), absl::Cord(absl::StrCat(limit.option, "=", limit.value)));
  return status;
}

std::optional<Limit> LimitOf(const absl::Status& status) {
  const auto payload = status.GetPayload(ToAbsl(kLimitUrl));
  if (!payload) return std::nullopt;
  const std::string text(*payload);
  const std::size_t equals = text.find('=');
  Limit limit{.option = text.substr(0, equals)};
  if (equals == text.npos || !absl::SimpleAtoi(text.substr(equals + 1), &limit.value)) return std::nullopt;
  return limit;
}

}  // namespace orbitune
