#include "server/rest/credentials.h"

#include "server/access/credentials.h"
#include "server/rest/text.h"

namespace orbitune::rest {
namespace {

std::string_view CookieOf(const HttpRequest& request) {
  for (std::string_view pair : Split(request.header("Cookie"), ';')) {
    pair = Trim(pair);
    const std::size_t equals = pair.find('=');
    if (equals != pair.npos && pair.substr(0, equals) == CookieName(request)) return pair.substr(equals + 1);
  }
  return {};
}

}  // namespace

Credentials CredentialsOf(const HttpRequest& request) {
  return {.token = BearerToken(request.header("Authorization")),
          .session = CookieOf(request),
          .peer = request.peer,
          .request_id = std::string(UsableRequestId(request.header("X-Request-Id")))};
}

bool ByCookie(const HttpRequest& request) {
  return BearerToken(request.header("Authorization")).empty() && !CookieOf(request).empty();
}

}  // namespace orbitune::rest
