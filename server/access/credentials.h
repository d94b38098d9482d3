// What both transports read alike of what comes with a request to say who sends it.
#pragma once

#include <string_view>

namespace orbitune {

// The token of "Bearer TOKEN", whatever the case of the scheme. Whatever else is there is given as it stands, for a
// wrong token: who sends something is never taken for who sends nothing.
std::string_view BearerToken(std::string_view authorization);

// The client's own id of a request, where it can be told back and logged (printable, at most 64 characters); else
// empty.
std::string_view UsableRequestId(std::string_view id);

}  // namespace orbitune
