// Who may call the server, and who did what: tokens and the audit log, in access.db beside the jobs' database. A file
// of its own, so that `orbituned token` can write beside a running server, and so that a backup put back brings no
// revoked token back and takes no entry away.
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"

namespace orbitune {

class Connection;

// Each may do what those before it may.
enum class Role { kNone, kViewer, kOperator, kAdmin };

// "none", "viewer", "operator", "admin".
constexpr std::string_view NameOf(Role role) {
  constexpr std::string_view kNames[] = {"none", "viewer", "operator", "admin"};
  return kNames[static_cast<std::size_t>(role)];
}

// Nothing for a text that is no role's name; "none" is none.
std::optional<Role> RoleOf(std::string_view name);

// Times: microseconds since the Unix epoch, UTC.
struct TokenRecord {
  std::string id;    // names it in lists and in the audit log; no secret
  std::string name;  // whose it is: what it creates is owned by this name; several tokens may have the same
  Role role = Role::kNone;
  std::string digest;  // SHA-256 of the secret in hexadecimal; the secret itself is nowhere
  std::int64_t create_time_us = 0;
  std::int64_t expire_time_us = 0;     // 0: never
  std::int64_t revoke_time_us = 0;     // 0: not revoked
  std::int64_t last_used_time_us = 0;  // to the minute; 0: never

  bool ValidAt(std::int64_t now_us) const {
    return revoke_time_us == 0 && (expire_time_us == 0 || now_us < expire_time_us);
  }
};

struct AuditEntry {
  std::int64_t number = 0;  // given by the store, rising
  std::int64_t time_us = 0;
  std::string caller;  // the token's name, "local" without tokens; empty: nobody known
  std::string role;
  std::string token_id;  // empty: called without one
  std::string peer;      // IP address
  std::string method;    // the RPC's full name, or what was done else
  std::string resource;  // "jobs/abc"; empty: none
  std::string outcome;   // the status code's name
  std::string request_id;
  std::int64_t count = 1;  // refusals alike are counted, not listed; of the first of them
};

struct AuditQuery {
  std::int64_t since_us = 0;                                         // entries of this time and later
  std::int64_t until_us = std::numeric_limits<std::int64_t>::max();  // and before this
  std::int64_t after_number = 0;
  int limit = 1000;
};

// Thread-safe; waits for the disk. Errors as Connection says (sqlite_connection.h).
class AccessStore {
 public:
  // Creates the file, for its owner's eyes only. DATA_LOSS for another program's file, FAILED_PRECONDITION for a newer
  // version's.
  static absl::StatusOr<std::unique_ptr<AccessStore>> Open(const std::string& path);
  ~AccessStore();

  absl::Status AddToken(const TokenRecord& token);
  // The oldest first; revoked and expired ones, too: a token is never forgotten.
  absl::StatusOr<std::vector<TokenRecord>> ListTokens();
  // Those not yet revoked whose id or name it is. NOT_FOUND where there is none.
  absl::StatusOr<std::vector<TokenRecord>> RevokeTokens(const std::string& id_or_name, std::int64_t now_us);
  // Times by token id.
  absl::Status NoteUse(const std::map<std::string, std::int64_t>& last_used_us);

  // All or none, on disk when it returns.
  absl::Status Append(std::span<const AuditEntry> entries);
  // In order of number.
  absl::StatusOr<std::vector<AuditEntry>> ListAudit(const AuditQuery& query);
  // Removes the first entries, at most `limit`, that are of before `before_us`, up to the first that is not: what stays
  // has no gaps. In the same commit an entry says which have gone. How many; 0: nothing was written.
  absl::StatusOr<int> RemoveOldestAudit(std::int64_t before_us, int limit, std::int64_t now_us);

  // Another number whenever another process has written.
  absl::StatusOr<std::int64_t> ForeignChanges();

 private:
  explicit AccessStore(std::unique_ptr<Connection> connection);
  absl::StatusOr<std::vector<TokenRecord>> Tokens();  // under mutex_
  absl::Status Insert(const AuditEntry& entry);       // under mutex_

  std::mutex mutex_;
  const std::unique_ptr<Connection> connection_;  // guarded by mutex_
};

}  // namespace orbitune
