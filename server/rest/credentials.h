// How a request over HTTP says who sends it: "Authorization: Bearer TOKEN", or the cookie of the dashboard's session.
#pragma once

#include "server/access/access.h"
#include "server/rest/http.h"

namespace orbitune::rest {

// Browsers take a cookie of the first name only with Secure, and from this very host.
inline std::string_view CookieName(const HttpRequest& request) {
  return request.secure ? "__Host-orbitune_session" : "orbitune_session";
}

// Views into the request.
Credentials CredentialsOf(const HttpRequest& request);

// Whether it is the cookie that counts, which a browser sends by itself: then what changes something must come from a
// page of this server.
bool ByCookie(const HttpRequest& request);

}  // namespace orbitune::rest
