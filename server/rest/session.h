// The dashboard's session, and what an HTTP request is refused with that comes without valid credentials.
#pragma once

#include "server/access/access.h"
#include "server/rest/http.h"

namespace orbitune::rest {

// 401 and 403, 429 with what a client needs to know: WWW-Authenticate, Retry-After.
HttpReply AccessRefusal(const absl::Status& refusal, const HttpRequest& request);

// POST /v1/session {"token": "..."}: the caller, as GET /v1/caller has it, and the cookie. May block.
HttpReply LogIn(Access* access, const HttpRequest& request);

// DELETE /v1/session.
HttpReply LogOut(Access* access, const HttpRequest& request);

}  // namespace orbitune::rest
