// Who calls: what a transport has found out about the sender of a request.
#pragma once

#include <string>

#include "storage/access_store.h"

namespace orbitune {

struct Caller {
  std::string name;  // the token's; "local" where the server has no tokens, and everybody is an admin
  Role role = Role::kNone;
  std::string token_id;  // names the token without telling it; empty: called without one
  // Names the dashboard's session that stood for the token, likewise; empty: the token itself came.
  std::string session_id;
  std::string peer;        // IP address, without the port
  std::string request_id;  // the client's own, else made up; never empty

  // What was sent, the end of which ends what the caller has open; empty: nothing.
  const std::string& credential_id() const { return session_id.empty() ? token_id : session_id; }

  // Whose what it creates becomes: nobody's where the server has no tokens.
  std::string owner() const { return token_id.empty() ? "" : name; }

  // Who shares limits, and turns, with whom: the token's name, else the address.
  std::string client() const { return token_id.empty() ? peer : name; }
};

inline constexpr char kLocalName[] = "local";

// Where the server has no tokens.
inline Caller LocalCaller(std::string peer, std::string request_id = "local") {
  return {.name = kLocalName,
          .role = Role::kAdmin,
          .token_id = {},
          .session_id = {},
          .peer = std::move(peer),
          .request_id = std::move(request_id)};
}

}  // namespace orbitune
