#include "server/rest/http.h"

#include <algorithm>
#include <cctype>

#include "absl/strings/str_cat.h"
#include "core/base/status.h"
#include "server/rest/text.h"

namespace orbitune::rest {
namespace {

// RFC 3986, and what clients are known to leave as it is.
constexpr char kTargetCharacters[] =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~:/?[]@!$&'()*+,;=%|^`{}<>\"\\";

int HexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  const char lower = static_cast<char>(c | 0x20);
  return lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
}

// Whether a media range's or coding's parameters say q=0.
bool Refused(std::string_view parameters) {
  const std::size_t q = parameters.find("q=");
  if (q == parameters.npos) return false;
  const std::string_view value = Trim(parameters.substr(q + 2));
  return !value.empty() && value.find_first_not_of("0.") == value.npos;
}

absl::StatusOr<std::vector<Query>> ParseQuery(std::string_view text) {
  std::vector<Query> query;
  for (const std::string_view pair : Split(text, '&')) {
    if (pair.empty()) continue;
    const std::size_t equals = std::min(pair.find('='), pair.size());
    auto name = PercentDecode(pair.substr(0, equals), true);
    if (!name.ok()) return name.status();
    auto value = PercentDecode(pair.substr(std::min(equals + 1, pair.size())), true);
    if (!value.ok()) return value.status();
    query.push_back({*std::move(name), *std::move(value)});
  }
  return query;
}

}  // namespace

bool NoCase::operator()(std::string_view a, std::string_view b) const {
  return std::ranges::lexicographical_compare(a, b, {}, Lower, Lower);
}

std::string_view HttpRequest::header(std::string_view name) const {
  const auto found = headers.find(std::string(name));
  return found == headers.end() ? std::string_view() : found->second;
}

absl::StatusOr<std::string> PercentDecode(std::string_view text, bool plus_is_space) {
  std::string decoded;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%') {
      const int high = i + 2 < text.size() ? HexDigit(text[i + 1]) : -1;
      const int low = i + 2 < text.size() ? HexDigit(text[i + 2]) : -1;
      if (high < 0 || low < 0) {
        return absl::InvalidArgumentError(absl::StrCat("not a percent-encoding: ", FormatReceived(text)));
      }
      decoded += static_cast<char>(high << 4 | low);
      i += 2;
    } else {
      decoded += plus_is_space && text[i] == '+' ? ' ' : text[i];
    }
  }
  if (!IsUtf8(decoded) || decoded.find('\0') != decoded.npos) {
    return absl::InvalidArgumentError(absl::StrCat("not UTF-8 text when decoded: ", FormatReceived(text)));
  }
  return decoded;
}

absl::StatusOr<Target> ParseTarget(std::string_view target) {
  if (target.find_first_not_of(kTargetCharacters) != target.npos) {
    return absl::InvalidArgumentError("the request's target must be ASCII without spaces, the rest percent-encoded");
  }
  // A proxy's form has the host before the path.
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (!target.starts_with(scheme)) continue;
    target.remove_prefix(std::min(target.find('/', scheme.size()), target.size()));
  }
  if (!target.starts_with('/')) return absl::InvalidArgumentError("the request's target must be a path");
  const std::size_t question = std::min(target.find('?'), target.size());
  Target parsed{.path = std::string(target.substr(0, question)), .query = {}};
  auto query = ParseQuery(target.substr(std::min(question + 1, target.size())));
  if (!query.ok()) return query.status();
  parsed.query = *std::move(query);
  return parsed;
}

bool Accepts(std::string_view header, std::string_view token) {
  for (const std::string_view item : Split(header, ',')) {
    const std::size_t semicolon = std::min(item.find(';'), item.size());
    if (EqualNoCase(Trim(item.substr(0, semicolon)), token)) return !Refused(item.substr(semicolon));
  }
  return false;
}

}  // namespace orbitune::rest
