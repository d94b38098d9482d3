// Requests and replies as the gateway sees them: HTTP without sockets.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"

namespace orbitune::rest {

// Header names compare without regard to case.
struct NoCase {
  bool operator()(std::string_view a, std::string_view b) const;
};

struct HttpRequest {
  std::string method;  // "GET"
  std::string target;  // as sent: path, and query
  std::map<std::string, std::string, NoCase> headers;
  std::string body;
  std::string peer;     // IP address
  bool secure = false;  // came under TLS

  // Empty where there is none.
  std::string_view header(std::string_view name) const;
};

struct HttpReply {
  int code = 200;
  std::vector<std::pair<std::string, std::string>> headers;
  std::string body;
};

struct Query {
  std::string name;
  std::string value;
};

// A request's target, taken apart. Segments are percent-encoded still: "%2F" is part of a segment.
struct Target {
  std::string path;
  std::vector<Query> query;  // decoded
};

// INVALID_ARGUMENT for what is no path, and for a query that does not decode.
absl::StatusOr<Target> ParseTarget(std::string_view target);

// INVALID_ARGUMENT for a wrong escape and for what is not UTF-8 or has a NUL.
absl::StatusOr<std::string> PercentDecode(std::string_view text, bool plus_is_space);

// Whether a comma-separated header names `token` (parameters are ignored, q=0 is no).
bool Accepts(std::string_view header, std::string_view token);

}  // namespace orbitune::rest
