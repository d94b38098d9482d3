#include "core/base/status.h"

#include <array>
#include <charconv>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace orbitune {
namespace {

constexpr std::string_view kViolationsUrl = "orbitune/field-violations";
constexpr std::string_view kReasonUrl = "orbitune/reason";
// Neither occurs in a field's path or a description: FormatReceived leaves no control characters.
constexpr char kFieldEnd = '\x1f';
constexpr char kViolationEnd = '\x1e';
constexpr std::size_t kLongestReceived = 80;

std::string PayloadOf(const absl::Status& status, std::string_view url) {
  auto payload = status.GetPayload(ToAbsl(url));
  return payload ? std::string(*payload) : std::string();
}

}  // namespace

std::string FormatNumber(double value) {
  std::array<char, 32> buffer{};
  const auto result = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return {buffer.data(), result.ptr};
}

std::string FormatReceived(std::string_view text) {
  std::string shown = "\"";
  for (const char c : text.substr(0, kLongestReceived)) {
    shown += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? '?' : c;
  }
  // Never cut a UTF-8 character in two.
  if (text.size() > kLongestReceived) {
    while (shown.size() > 1 && (static_cast<unsigned char>(shown.back()) & 0xc0) == 0x80) shown.pop_back();
    if (shown.size() > 1 && (static_cast<unsigned char>(shown.back()) & 0x80) != 0) shown.pop_back();
    absl::StrAppend(&shown, "\"... (", text.size(), " bytes)");
    return shown;
  }
  return shown + '"';
}

void FieldErrors::Add(std::string_view field, std::string_view allowed, std::string_view received) {
  violations_.push_back({std::string(field), absl::StrCat("must be ", ToAbsl(allowed), ", got ", ToAbsl(received))});
}

void FieldErrors::AddNumber(std::string_view field, std::string_view allowed, double received) {
  Add(field, allowed, FormatNumber(received));
}

void FieldErrors::Merge(std::string_view prefix, const absl::Status& status) {
  if (status.ok()) return;
  const auto violations = FieldViolationsOf(status);
  if (violations.empty()) {
    violations_.push_back({std::string(prefix), std::string(status.message())});
    return;
  }
  for (const auto& v : violations) {
    violations_.push_back({absl::StrCat(ToAbsl(prefix), ".", v.field), v.description});
  }
}

absl::Status FieldErrors::ToStatus() const {
  if (violations_.empty()) return absl::OkStatus();
  std::string message;
  std::string payload;
  for (const auto& v : violations_) {
    absl::StrAppend(&message, message.empty() ? "" : "; ", v.field, ": ", v.description);
    absl::StrAppend(&payload, v.field, std::string(1, kFieldEnd), v.description, std::string(1, kViolationEnd));
  }
  absl::Status status = absl::InvalidArgumentError(message);
  status.SetPayload(ToAbsl(kViolationsUrl), absl::Cord(payload));
  return status;
}

absl::Status InvalidField(std::string_view field, std::string_view allowed, double received) {
  FieldErrors errors;
  errors.AddNumber(field, allowed, received);
  return errors.ToStatus();
}

std::vector<FieldViolation> FieldViolationsOf(const absl::Status& status) {
  std::vector<FieldViolation> violations;
  const std::string payload = PayloadOf(status, kViolationsUrl);
  for (const absl::string_view entry : absl::StrSplit(payload, kViolationEnd, absl::SkipEmpty())) {
    const std::pair<std::string, std::string> parts = absl::StrSplit(entry, absl::MaxSplits(kFieldEnd, 1));
    violations.push_back({parts.first, parts.second});
  }
  return violations;
}

absl::Status WithReason(absl::Status status, std::string_view reason) {
  status.SetPayload(ToAbsl(kReasonUrl), absl::Cord(ToAbsl(reason)));
  return status;
}

std::string ReasonOf(const absl::Status& status) { return PayloadOf(status, kReasonUrl); }

}  // namespace orbitune
