#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "storage/access_store.h"
#include "storage/sqlite_connection.h"

namespace orbitune {
namespace {

constexpr std::int64_t kApplicationId = 0x4f524241;  // "ORBA"
constexpr std::int64_t kVersion = 1;

constexpr char kAuditKeepsRows[] = R"sql(
CREATE TRIGGER audit_log_keeps_rows BEFORE DELETE ON audit_log
BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END;
)sql";

// The triggers are against mistakes, ours first of all; whoever may write the file can remove them.
constexpr char kSchema[] = R"sql(
CREATE TABLE tokens (
  id                TEXT PRIMARY KEY,
  name              TEXT NOT NULL,
  role              TEXT NOT NULL CHECK (role IN ('viewer', 'operator', 'admin')),
  digest            TEXT NOT NULL,     -- SHA-256 of the secret
  create_time_us    INTEGER NOT NULL,  -- microseconds since 1970, UTC
  expire_time_us    INTEGER NOT NULL,  -- 0: never
  revoke_time_us    INTEGER NOT NULL,  -- 0: not revoked
  last_used_time_us INTEGER NOT NULL   -- 0: never
) STRICT;
CREATE TRIGGER tokens_are_kept BEFORE DELETE ON tokens
BEGIN SELECT RAISE(ABORT, 'a token is revoked, not deleted'); END;
CREATE TRIGGER tokens_are_constant BEFORE UPDATE OF id, name, role, digest, create_time_us, expire_time_us ON tokens
BEGIN SELECT RAISE(ABORT, 'a token does not change'); END;
CREATE TRIGGER tokens_stay_revoked BEFORE UPDATE OF revoke_time_us ON tokens WHEN OLD.revoke_time_us <> 0
BEGIN SELECT RAISE(ABORT, 'a revoked token stays revoked'); END;

CREATE TABLE audit_log (
  number     INTEGER PRIMARY KEY AUTOINCREMENT,
  time_us    INTEGER NOT NULL,
  caller     TEXT NOT NULL,
  role       TEXT NOT NULL,
  token_id   TEXT NOT NULL,
  peer       TEXT NOT NULL,
  method     TEXT NOT NULL,
  resource   TEXT NOT NULL,
  outcome    TEXT NOT NULL,
  request_id TEXT NOT NULL,
  count      INTEGER NOT NULL
) STRICT;
CREATE INDEX audit_log_by_time ON audit_log (time_us);
CREATE TRIGGER audit_log_keeps_values BEFORE UPDATE ON audit_log
BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END;
CREATE TRIGGER audit_log_keeps_numbers BEFORE INSERT ON audit_log
WHEN EXISTS (SELECT 1 FROM audit_log WHERE number = NEW.number)
BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END;
)sql";

// SQLite gives the files beside it the same rights.
absl::Status CreateForOwner(const std::string& path) {
  const int fd = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (fd < 0) return absl::UnavailableError(absl::StrCat(path, ": ", std::strerror(errno)));
  close(fd);
  return absl::OkStatus();
}

absl::Status Prepare(Connection& db) {
  if (absl::Status status = db.Execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;"); !status.ok()) {
    return status;
  }
  auto transaction = Transaction::Begin(db, Transaction::Kind::kWrite);
  if (!transaction.ok()) return transaction.status();
  const auto id = db.QueryInt("PRAGMA application_id");
  const auto version = db.QueryInt("PRAGMA user_version");
  const auto tables = db.QueryInt("SELECT count(*) FROM sqlite_schema");
  for (const auto* read : {&id, &version, &tables}) {
    if (!read->ok()) return read->status();
  }
  if (*id != kApplicationId && (*id != 0 || *version != 0 || *tables != 0)) {
    return absl::DataLossError(absl::StrCat(db.path(), ": not Orbitune's tokens and audit log"));
  }
  if (*version > kVersion) {
    return absl::FailedPreconditionError(absl::StrCat(db.path(), ": of a newer Orbitune (version ", *version,
                                                      ", this one knows ", kVersion, "): use that one"));
  }
  if (*version == kVersion) return absl::OkStatus();
  const std::string marks =
      absl::StrCat("PRAGMA application_id = ", kApplicationId, "; PRAGMA user_version = ", kVersion, ";");
  if (absl::Status status = db.Execute(absl::StrCat(kSchema, kAuditKeepsRows, marks)); !status.ok()) return status;
  return transaction->Commit();
}

TokenRecord ReadToken(const Statement& row) {
  return {.id = row.Text(0),
          .name = row.Text(1),
          .role = RoleOf(row.Text(2)).value_or(Role::kNone),
          .digest = row.Text(3),
          .create_time_us = row.Int(4),
          .expire_time_us = row.Int(5),
          .revoke_time_us = row.Int(6),
          .last_used_time_us = row.Int(7)};
}

AuditEntry ReadEntry(const Statement& row) {
  return {.number = row.Int(0),
          .time_us = row.Int(1),
          .caller = row.Text(2),
          .role = row.Text(3),
          .token_id = row.Text(4),
          .peer = row.Text(5),
          .method = row.Text(6),
          .resource = row.Text(7),
          .outcome = row.Text(8),
          .request_id = row.Text(9),
          .count = row.Int(10)};
}

// Of the entries from the first on, up to one that is not so old.
absl::StatusOr<std::vector<std::int64_t>> FirstNumbersBefore(Connection& db, std::int64_t before_us, int limit) {
  auto statement = db.Prepare("SELECT number, time_us FROM audit_log ORDER BY number LIMIT ?");
  if (!statement.ok()) return statement.status();
  statement->Bind(limit);
  std::vector<std::int64_t> numbers;
  bool old = true;
  absl::Status status = statement->ForEachRow([&] {
    old = old && statement->Int(1) < before_us;
    if (old) numbers.push_back(statement->Int(0));
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return numbers;
}

}  // namespace

std::optional<Role> RoleOf(std::string_view name) {
  for (const Role role : {Role::kViewer, Role::kOperator, Role::kAdmin}) {
    if (NameOf(role) == name) return role;
  }
  return std::nullopt;
}

absl::StatusOr<std::unique_ptr<AccessStore>> AccessStore::Open(const std::string& path) {
  if (absl::Status status = CreateForOwner(path); !status.ok()) return status;
  auto connection = Connection::Open(path, Connection::Mode::kReadWrite);
  if (!connection.ok()) return connection.status();
  if (absl::Status status = Prepare(**connection); !status.ok()) return status;
  return std::unique_ptr<AccessStore>(new AccessStore(*std::move(connection)));
}

AccessStore::AccessStore(std::unique_ptr<Connection> connection) : connection_(std::move(connection)) {}
AccessStore::~AccessStore() = default;

absl::Status AccessStore::AddToken(const TokenRecord& token) {
  const std::lock_guard lock(mutex_);
  return connection_->Run("INSERT INTO tokens VALUES (?, ?, ?, ?, ?, ?, ?, ?)", token.id, token.name,
                          NameOf(token.role), token.digest, token.create_time_us, token.expire_time_us,
                          token.revoke_time_us, token.last_used_time_us);
}

absl::StatusOr<std::vector<TokenRecord>> AccessStore::Tokens() {
  auto statement = connection_->Prepare("SELECT * FROM tokens ORDER BY create_time_us, id");
  if (!statement.ok()) return statement.status();
  std::vector<TokenRecord> tokens;
  absl::Status status = statement->ForEachRow([&] {
    tokens.push_back(ReadToken(*statement));
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return tokens;
}

absl::StatusOr<std::vector<TokenRecord>> AccessStore::ListTokens() {
  const std::lock_guard lock(mutex_);
  return Tokens();
}

absl::StatusOr<std::vector<TokenRecord>> AccessStore::RevokeTokens(const std::string& id_or_name, std::int64_t now_us) {
  const std::lock_guard lock(mutex_);
  auto transaction = Transaction::Begin(*connection_, Transaction::Kind::kWrite);
  if (!transaction.ok()) return transaction.status();
  const auto tokens = Tokens();
  if (!tokens.ok()) return tokens.status();
  std::vector<TokenRecord> revoked;
  for (const TokenRecord& token : *tokens) {
    if (token.revoke_time_us != 0 || (token.id != id_or_name && token.name != id_or_name)) continue;
    absl::Status status = connection_->Run("UPDATE tokens SET revoke_time_us = ? WHERE id = ?", now_us, token.id);
    if (!status.ok()) return status;
    revoked.push_back(token);
    revoked.back().revoke_time_us = now_us;
  }
  if (revoked.empty()) {
    return absl::NotFoundError(
        absl::StrCat("no token with the id or name ", FormatReceived(id_or_name), " that is not revoked"));
  }
  if (absl::Status status = transaction->Commit(); !status.ok()) return status;
  return revoked;
}

absl::Status AccessStore::NoteUse(const std::map<std::string, std::int64_t>& last_used_us) {
  const std::lock_guard lock(mutex_);
  auto transaction = Transaction::Begin(*connection_, Transaction::Kind::kWrite);
  if (!transaction.ok()) return transaction.status();
  for (const auto& [id, time_us] : last_used_us) {
    absl::Status status = connection_->Run("UPDATE tokens SET last_used_time_us = ? WHERE id = ?", time_us, id);
    if (!status.ok()) return status;
  }
  return transaction->Commit();
}

absl::Status AccessStore::Append(std::span<const AuditEntry> entries) {
  const std::lock_guard lock(mutex_);
  auto transaction = Transaction::Begin(*connection_, Transaction::Kind::kWrite);
  if (!transaction.ok()) return transaction.status();
  for (const AuditEntry& entry : entries) {
    if (absl::Status status = Insert(entry); !status.ok()) return status;
  }
  return transaction->Commit();
}

absl::Status AccessStore::Insert(const AuditEntry& e) {
  return connection_->Run(
      "INSERT INTO audit_log (time_us, caller, role, token_id, peer, method, resource, outcome, request_id, count) "
      "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
      e.time_us, e.caller, e.role, e.token_id, e.peer, e.method, e.resource, e.outcome, e.request_id, e.count);
}

absl::StatusOr<int> AccessStore::RemoveOldestAudit(std::int64_t before_us, int limit, std::int64_t now_us) {
  const std::lock_guard lock(mutex_);
  auto transaction = Transaction::Begin(*connection_, Transaction::Kind::kWrite);
  if (!transaction.ok()) return transaction.status();
  const auto numbers = FirstNumbersBefore(*connection_, before_us, limit);
  if (!numbers.ok()) return numbers.status();
  if (numbers->empty()) return 0;
  // The trigger is away within this transaction alone.
  absl::Status status = connection_->Execute("DROP TRIGGER IF EXISTS audit_log_keeps_rows");
  if (status.ok()) status = connection_->Run("DELETE FROM audit_log WHERE number <= ?", numbers->back());
  if (status.ok()) status = connection_->Execute(kAuditKeepsRows);
  if (status.ok()) {
    status = Insert({.time_us = now_us,
                     .caller = "orbituned",
                     .method = "audit retention",
                     .resource = absl::StrCat("auditEntries/", numbers->front(), " to ", numbers->back()),
                     .outcome = "OK",
                     .count = static_cast<std::int64_t>(numbers->size())});
  }
  if (status.ok()) status = transaction->Commit();
  if (!status.ok()) return status;
  return static_cast<int>(numbers->size());
}

absl::StatusOr<std::vector<AuditEntry>> AccessStore::ListAudit(const AuditQuery& query) {
  const std::lock_guard lock(mutex_);
  auto statement = connection_->Prepare(
      "SELECT * FROM audit_log WHERE number > ? AND time_us >= ? AND time_us < ? ORDER BY number LIMIT ?");
  if (!statement.ok()) return statement.status();
  statement->Bind(query.after_number, query.since_us, query.until_us, query.limit);
  std::vector<AuditEntry> entries;
  absl::Status status = statement->ForEachRow([&] {
    entries.push_back(ReadEntry(*statement));
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return entries;
}

absl::StatusOr<std::int64_t> AccessStore::ForeignChanges() {
  const std::lock_guard lock(mutex_);
  return connection_->QueryInt("PRAGMA data_version");
}

}  // namespace orbitune
