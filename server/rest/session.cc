#include "server/rest/session.h"

#include "absl/strings/str_cat.h"
#include "orbitune/v1/audit.pb.h"
#include "server/api/access_api.h"
#include "server/api/json.h"
#include "server/rest/credentials.h"
#include "server/rest/error.h"

namespace orbitune::rest {
namespace {

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

HttpReply AccessRefusal(const absl::Status& refusal, const HttpRequest& request) {
  HttpReply reply = ErrorReply(refusal);
  if (!absl::IsUnauthenticated(refusal)) return reply;
  const bool given = !CredentialsOf(request).token.empty();
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
  if (access != nullptr) access->LogOut(CredentialsOf(request).session);
  return {.code = 204,
          .headers = {{"Set-Cookie", SetCookie(request, "", std::chrono::seconds(0))}, {"Cache-Control", "no-store"}},
          .body = {}};
}

}  // namespace orbitune::rest
