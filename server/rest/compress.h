// Replies in gzip, for clients that take it: long histories and trajectories are mostly digits and field names.
#pragma once

#include "server/rest/http.h"

namespace orbitune::rest {

// Replaces a body of a kilobyte or more by its gzip form, and says so in the headers; leaves a shorter one alone.
void Compress(HttpReply& reply);

}  // namespace orbitune::rest
