#include "server/rest/session.h"

#include "absl/strings/str_cat.h"
#include "orbitune/v1/audit.pb.h"
#include "server/api/access_api.h"
#include "server/api/json.h"
#include "server/rest/error.h"
#include "server/rest/text.h"

namespace orbitune::rest {
namespace {

constexpr std::size_t kLongestRequestId = 64;

// Browsers take a cookie of the first name only with Secure, and from this very host.
std::string_view CookieName(const HttpRequest& request) {
  return request.secure ? "__Host-orbitune_session" : "orbitune_session";
}

std::string_view CookieOf(const HttpRequest& request) {
  for (std::string_view pair : Split(request.header("Cookie"), ';')) {
    pair = Trim(pair);
    const std::size_t equals = pair.find('=');
    if (equals != pair.npos && pair.substr(0, equals) == CookieName(request)) return pair.substr(equals + 1);
  }
  return {};
}

// Whatever else is there is a wrong token.
std::string_view TokenOf(const HttpRequest& request) {
  const std::string_view value = Trim(request.header("Authorization"));
  static constexpr std::string_view kScheme = "Bearer ";
  return EqualNoCase(value.substr(0, kScheme.size()), kScheme) ? Trim(value.substr(kScheme.size())) : value;
}

std::string SetCookie(const HttpRequest& request, std::string_view value, std::chrono::seconds time) {
  return absl::StrCat(ToAbsl(CookieName(request)), "=", ToAbsl(value),
                      "; Path=/; HttpOnly; SameSite=Strict; Max-Age=", time.count(), request.secure ? "; Secure" : "");
}

HttpReply ToReply(const Caller& caller) {
  v1::Caller out;
  out.set_name(caller.name);
  out.set_role(ToProto(caller.role));
  out.set_has_token(!caller.token_id.empty());
  return {.code = 200,
          .headers = {{"Content-Type", "application/json"}, {"Cache-Control", "no-store"}},
          .body = ToJson(out) + "\n"};
}

}  // namespace

Credentials CredentialsOf(const HttpRequest& request) {
  const std::string_view id = request.header("X-Request-Id");
  const bool usable =
      id.size() <= kLongestRequestId && std::ranges::all_of(id, [](char c) { return c > ' ' && c <= '~'; });
  return {.token = TokenOf(request),
          .session = CookieOf(request),
          .peer = request.peer,
          .request_id = usable ? std::string(id) : std::string()};
}

bool ByCookie(const HttpRequest& request) { return TokenOf(request).empty() && !CookieOf(request).empty(); }

HttpReply AccessRefusal(const absl::Status& refusal, const HttpRequest& request) {
  HttpReply reply = ErrorReply(refusal);
  if (!absl::IsUnauthenticated(refusal)) return reply;
  const bool given = !TokenOf(request).empty();
  reply.headers.emplace_back(
      "WWW-Authenticate", given ? R"(Bearer realm="orbitune", error="invalid_token")" : R"(Bearer realm="orbitune")");
  reply.headers.emplace_back("Cache-Control", "no-store");
  if (ByCookie(request)) reply.headers.emplace_back("Set-Cookie", SetCookie(request, "", std::chrono::seconds(0)));
  return reply;
}

HttpReply LogIn(Access* access, const HttpRequest& request) {
  v1::CreateSessionRequest body;
  // The parser's own words would quote the token.
  if (request.body.empty() || !FromJson(request.body, &body).ok() || body.token().empty()) {
    return ErrorReply(absl::InvalidArgumentError("the body: must be {\"token\": \"...\"}"));
  }
  if (access == nullptr) return ToReply(LocalCaller(request.peer));
  Credentials credentials = CredentialsOf(request);
  credentials.token = body.token();
  const auto session = access->LogIn(credentials);
  if (!session.ok()) return AccessRefusal(session.status(), request);
  HttpReply reply = ToReply(session->caller);
  if (!session->secret.empty()) {
    reply.headers.emplace_back("Set-Cookie", SetCookie(request, session->secret, session->time));
  }
  return reply;
}

HttpReply LogOut(Access* access, const HttpRequest& request) {
  if (access != nullptr) access->LogOut(CookieOf(request));
  return {.code = 204,
          .headers = {{"Set-Cookie", SetCookie(request, "", std::chrono::seconds(0))}, {"Cache-Control", "no-store"}},
          .body = {}};
}

}  // namespace orbitune::rest
