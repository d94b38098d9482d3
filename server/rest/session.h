// How a request over HTTP says who sends it: "Authorization: Bearer TOKEN", or the cookie of the dashboard's session.
#pragma once

#include "server/access/access.h"
#include "server/rest/http.h"

namespace orbitune::rest {

// Views into the request.
Credentials CredentialsOf(const HttpRequest& request);

// Whether it is the cookie that counts, which a browser sends by itself: then what changes something must come from a
// page of this server.
bool ByCookie(const HttpRequest& request);

// 401 and 403, 429 with what a client needs to know: WWW-Authenticate, Retry-After.
HttpReply AccessRefusal(const absl::Status& refusal, const HttpRequest& request);

// POST /v1/session {"token": "..."}: the caller, as GET /v1/caller has it, and the cookie. May block.
HttpReply LogIn(Access* access, const HttpRequest& request);

// DELETE /v1/session.
HttpReply LogOut(Access* access, const HttpRequest& request);

}  // namespace orbitune::rest
