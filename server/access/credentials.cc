#include "server/access/credentials.h"

#include <algorithm>

#include "server/access/text.h"

namespace orbitune {
namespace {

constexpr std::size_t kLongestRequestId = 64;

}  // namespace

std::string_view BearerToken(std::string_view authorization) {
  constexpr std::string_view kScheme = "bearer ";
  authorization = Trim(authorization);
  const bool is_bearer = std::ranges::equal(authorization.substr(0, kScheme.size()), kScheme, {}, Lower);
  return is_bearer ? Trim(authorization.substr(kScheme.size())) : authorization;
}

std::string_view UsableRequestId(std::string_view id) {
  const bool usable =
      id.size() <= kLongestRequestId && std::ranges::all_of(id, [](char c) { return c > ' ' && c <= '~'; });
  return usable ? id : std::string_view();
}

}  // namespace orbitune
