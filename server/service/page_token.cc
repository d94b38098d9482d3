#include "server/service/page_token.h"

#include <algorithm>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "core/base/status.h"

namespace orbitune {
namespace {

// FNV-1a: tokens are no secret, the sum only tells damage and a mix-up from a token that was handed out.
std::uint64_t Checksum(std::string_view text) {
  std::uint64_t hash = 0xcbf29ce484222325;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3;
  return hash;
}

std::string Seal(std::string_view list, const std::vector<std::string>& parts) {
  return absl::StrCat(absl::Hex(Checksum(absl::StrCat(ToAbsl(list), "\n", absl::StrJoin(parts, "\n")))));
}

}  // namespace

std::string MakePageToken(std::string_view list, const std::vector<std::string>& parts) {
  return absl::WebSafeBase64Escape(absl::StrCat(Seal(list, parts), "\n", absl::StrJoin(parts, "\n")));
}

absl::StatusOr<std::vector<std::string>> ReadPageToken(std::string_view token, std::string_view list,
                                                       std::size_t part_count) {
  std::string text;
  if (absl::WebSafeBase64Unescape(ToAbsl(token), &text)) {
    std::vector<std::string> parts = absl::StrSplit(text, '\n');
    const std::string seal = parts.front();
    parts.erase(parts.begin());
    if (parts.size() == part_count && seal == Seal(list, parts)) return parts;
  }
  FieldErrors errors;
  errors.Add("page_token",
             "empty, or the next_page_token of an answer to the same request (same parent, filter, order)",
             FormatReceived(token));
  return errors.ToStatus();
}

absl::StatusOr<int> PageSize(int requested, int default_size, int largest) {
  if (requested < 0) {
    return InvalidField("page_size", absl::StrCat(">= 0 (0: ", default_size, "; at most ", largest, " are given)"),
                        requested);
  }
  return requested == 0 ? default_size : std::min(requested, largest);
}

}  // namespace orbitune
