// Who calls: what a transport has found out about the sender of a request, handed with it to the API's methods.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

namespace orbitune {

// Each may do what those before it may.
enum class Role { kNone, kViewer, kOperator, kAdmin };

// "none", "viewer", "operator", "admin".
constexpr std::string_view NameOf(Role role) {
  constexpr std::string_view kNames[] = {"none", "viewer", "operator", "admin"};
  return kNames[static_cast<std::size_t>(role)];
}

struct Caller {
  std::string name;  // the token's; "local" where the server has no tokens, and everybody is an admin
  Role role = Role::kNone;
  std::string token_id;    // names the token without telling it; empty: called without one
  std::string peer;        // IP address, without the port
  std::string request_id;  // the client's own, else made up; never empty

  // Whose what it creates becomes: nobody's where the server has no tokens.
  std::string owner() const { return token_id.empty() ? "" : name; }
};

// Where the server has no tokens.
inline Caller LocalCaller(std::string peer) {
  return {.name = "local", .role = Role::kAdmin, .token_id = {}, .peer = std::move(peer), .request_id = "local"};
}

// Whether the caller has gone; asked now and then by what takes long.
using Cancelled = std::function<bool()>;

// A call, but for its request.
struct CallContext {
  Caller caller;
  Cancelled cancelled = [] { return false; };
};

}  // namespace orbitune
