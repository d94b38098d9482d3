// What says who sends a request: the headers Authorization, Cookie and X-Request-Id.
#include <algorithm>

#include "server/access/credentials.h"
#include "server/rest/credentials.h"
#include "server/rest/text.h"
#include "tests/fuzz/fuzz.h"

namespace orbitune::fuzz {
namespace {

bool IsBlank(std::string_view text) { return text.find_first_not_of(" \t") == text.npos; }

// Lines: under TLS or not; the three headers, each of which is not there where its line is empty.
void Headers(std::string_view input) {
  rest::HttpRequest request;
  request.secure = TakeChoice(input, 2) == 1;
  for (const char* const name : {"Authorization", "Cookie", "X-Request-Id"}) {
    const std::string_view value = TakeLine(input);
    if (!value.empty()) request.headers[name] = value;
  }
  const std::string_view authorization = request.header("Authorization");
  const std::string_view cookies = request.header("Cookie");
  const Credentials credentials = rest::CredentialsOf(request);
  Expect(credentials.token.empty() == IsBlank(authorization), "who sends something is not taken for who sends nothing");
  Expect(authorization.find(credentials.token) != authorization.npos, "a token is part of its header");
  Expect(Trim(credentials.token) == credentials.token, "a token has no blanks around it");
  Expect(credentials.session.find(';') == credentials.session.npos, "a cookie ends where the next begins");
  const std::string pair = std::string(rest::CookieName(request)) + "=" + std::string(credentials.session);
  Expect(credentials.session.empty() || cookies.find(pair) != cookies.npos, "a session is the value of its own cookie");
  Expect(rest::ByCookie(request) == (credentials.token.empty() && !credentials.session.empty()),
         "what is sent by a cookie is told from what is not");
  Expect(credentials.request_id.size() <= 64 &&
             std::ranges::all_of(credentials.request_id, [](char c) { return c > ' ' && c <= '~'; }),
         "a request id can be logged");
  for (const std::string_view secret : {credentials.token, credentials.session}) {
    const auto id = SecretId(secret);
    Expect(!id || secret.find(*id) != secret.npos, "the id of a secret is part of it");
  }
}

const Registration kCredentials("credentials", Headers);

}  // namespace
}  // namespace orbitune::fuzz
