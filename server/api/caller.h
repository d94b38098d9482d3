// A call as the API's methods see it, but for its request.
#pragma once

#include <functional>

#include "server/access/caller.h"

namespace orbitune {

// Whether the caller has gone; asked now and then by what takes long.
using Cancelled = std::function<bool()>;

struct CallContext {
  Caller caller;
  Cancelled cancelled = [] { return false; };
  std::string_view transport = "grpc";  // "sse", "ndjson", "http": a literal
};

}  // namespace orbitune
