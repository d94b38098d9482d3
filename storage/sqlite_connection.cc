#include "storage/sqlite_connection.h"

#include <sqlite3.h>

#include <bit>
#include <cstring>
#include <limits>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"

namespace orbitune {
namespace {

// How long a statement waits for a lock that another process holds (a backup, somebody's sqlite3 shell).
constexpr int kBusyTimeoutMs = 1000;

absl::StatusCode CodeOf(int result) {
  switch (result & 0xff) {
    case SQLITE_FULL:
    case SQLITE_IOERR:
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
    case SQLITE_PROTOCOL:
    case SQLITE_READONLY:
    case SQLITE_CANTOPEN:
    case SQLITE_PERM:
    case SQLITE_NOMEM:
      return absl::StatusCode::kUnavailable;
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return absl::StatusCode::kDataLoss;
    case SQLITE_INTERRUPT:
      return absl::StatusCode::kCancelled;
    default:
      return absl::StatusCode::kInternal;
  }
}

absl::Status MakeError(const std::string& path, int result, const char* message) {
  return absl::Status(CodeOf(result), absl::StrCat(path, ": ", message, " (SQLite error ", result, ")"));
}

}  // namespace

Statement::Statement(Statement&& other) noexcept
    : connection_(other.connection_),
      statement_(std::exchange(other.statement_, nullptr)),
      cached_(other.cached_),
      bind_error_(other.bind_error_) {}

Statement::~Statement() {
  if (statement_ == nullptr) return;
  if (cached_) {
    sqlite3_reset(statement_);
    sqlite3_clear_bindings(statement_);
  } else {
    sqlite3_finalize(statement_);
  }
}

void Statement::Note(int result) {
  if (bind_error_ == SQLITE_OK) bind_error_ = result;
}

void Statement::BindNull(int index) { Note(sqlite3_bind_null(statement_, index)); }

void Statement::BindInt(int index, std::int64_t value) { Note(sqlite3_bind_int64(statement_, index, value)); }

// SQLite itself takes NaN for NULL.
void Statement::BindReal(int index, double value) { Note(sqlite3_bind_double(statement_, index, value)); }

void Statement::BindText(int index, std::string_view value) {
  const char* text = value.data() == nullptr ? "" : value.data();  // a null pointer would become NULL
  Note(sqlite3_bind_text64(statement_, index, text, value.size(), SQLITE_TRANSIENT, SQLITE_UTF8));
}

static_assert(std::endian::native == std::endian::little, "blobs hold doubles as they lie in memory");

void Statement::BindDoubles(int index, std::span<const double> value) {
  Note(sqlite3_bind_blob64(statement_, index, value.data(), value.size_bytes(), SQLITE_TRANSIENT));
}

Statement& Statement::BindAll(std::span<const Value> values) {
  int index = 0;
  for (const Value& value : values) {
    ++index;
    std::visit([this, index](const auto& v) { BindOne(index, v); }, value);
  }
  return *this;
}

absl::StatusOr<bool> Statement::Step() {
  if (bind_error_ != SQLITE_OK) return connection_->Error(bind_error_);
  const int result = sqlite3_step(statement_);
  if (result == SQLITE_ROW) return true;
  if (result == SQLITE_DONE) return false;
  return connection_->Error(result);
}

absl::Status Statement::Run() {
  return ForEachRow([] { return absl::OkStatus(); });
}

absl::Status Statement::ForEachRow(const std::function<absl::Status()>& visit) {
  for (;;) {
    const absl::StatusOr<bool> row = Step();
    if (!row.ok()) return row.status();
    if (!*row) return absl::OkStatus();
    if (absl::Status status = visit(); !status.ok()) return status;
  }
}

std::int64_t Statement::Int(int column) const { return sqlite3_column_int64(statement_, column); }

double Statement::Real(int column) const {
  return IsNull(column) ? std::numeric_limits<double>::quiet_NaN() : sqlite3_column_double(statement_, column);
}

std::string Statement::Text(int column) const {
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
  if (text == nullptr) return {};
  return {text, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column))};
}

std::vector<double> Statement::Doubles(int column) const {
  const void* bytes = sqlite3_column_blob(statement_, column);
  if (bytes == nullptr) return {};
  std::vector<double> doubles(static_cast<std::size_t>(sqlite3_column_bytes(statement_, column)) / sizeof(double));
  std::memcpy(doubles.data(), bytes, doubles.size() * sizeof(double));
  return doubles;
}

bool Statement::IsNull(int column) const { return sqlite3_column_type(statement_, column) == SQLITE_NULL; }

bool Statement::IsNumberOrNull(int column) const {
  const int type = sqlite3_column_type(statement_, column);
  return type == SQLITE_FLOAT || type == SQLITE_INTEGER || type == SQLITE_NULL;
}

absl::StatusOr<std::unique_ptr<Connection>> Connection::Open(const std::string& path, Mode mode) {
  const int flags = SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE |
                    (mode == Mode::kReadOnly ? SQLITE_OPEN_READONLY : SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
  sqlite3* db = nullptr;
  const int result = sqlite3_open_v2(path.c_str(), &db, flags, nullptr);
  if (result != SQLITE_OK) {
    absl::Status error = MakeError(path, result, db == nullptr ? "out of memory" : sqlite3_errmsg(db));
    sqlite3_close_v2(db);
    return error;
  }
  sqlite3_busy_timeout(db, kBusyTimeoutMs);
  std::unique_ptr<Connection> connection(new Connection(path, db));
  absl::Status status = connection->Execute("PRAGMA foreign_keys = ON; PRAGMA cell_size_check = ON;");
  if (!status.ok()) return status;
  return connection;
}

Connection::~Connection() {
  for (const auto& [sql, statement] : cache_) sqlite3_finalize(statement);
  sqlite3_close_v2(db_);
}

absl::Status Connection::Error(int result) {
  ++failures_;
  const bool newest = (sqlite3_extended_errcode(db_) & 0xff) == (result & 0xff);
  return MakeError(path_, result, newest ? sqlite3_errmsg(db_) : sqlite3_errstr(result));
}

absl::StatusOr<sqlite3_stmt*> Connection::Compile(std::string_view sql, unsigned flags) {
  sqlite3_stmt* statement = nullptr;
  const int result = sqlite3_prepare_v3(db_, sql.data(), static_cast<int>(sql.size()), flags, &statement, nullptr);
  if (result != SQLITE_OK) return Error(result);
  return statement;
}

absl::StatusOr<Statement> Connection::Prepare(std::string_view sql) {
  auto found = cache_.find(sql);
  if (found == cache_.end()) {
    const absl::StatusOr<sqlite3_stmt*> statement = Compile(sql, SQLITE_PREPARE_PERSISTENT);
    if (!statement.ok()) return statement.status();
    found = cache_.emplace(sql, *statement).first;
  }
  ORBITUNE_CHECK(!sqlite3_stmt_busy(found->second));
  return Statement(this, found->second, /*cached=*/true);
}

absl::StatusOr<Statement> Connection::PrepareOnce(std::string_view sql) {
  const absl::StatusOr<sqlite3_stmt*> statement = Compile(sql, 0);
  if (!statement.ok()) return statement.status();
  return Statement(this, *statement, /*cached=*/false);
}

absl::StatusOr<std::int64_t> Connection::QueryInt(std::string_view sql) {
  auto statement = PrepareOnce(sql);
  if (!statement.ok()) return statement.status();
  const absl::StatusOr<bool> row = statement->Step();
  if (!row.ok()) return row.status();
  if (!*row) return absl::NotFoundError("no row");
  return statement->Int(0);
}

absl::Status Connection::Execute(const std::string& script) {
  const int result = sqlite3_exec(db_, script.c_str(), nullptr, nullptr, nullptr);
  return result == SQLITE_OK ? absl::OkStatus() : Error(result);
}

absl::Status Connection::CopyFrom(Connection& source) {
  sqlite3_backup* backup = sqlite3_backup_init(db_, "main", source.db_, "main");
  if (backup == nullptr) return Error(sqlite3_extended_errcode(db_));
  const int step = sqlite3_backup_step(backup, -1);
  const int finish = sqlite3_backup_finish(backup);
  if (step == SQLITE_DONE && finish == SQLITE_OK) return absl::OkStatus();
  return Error(step == SQLITE_DONE ? finish : step);
}

void Connection::Interrupt() { sqlite3_interrupt(db_); }

bool Connection::read_only() const { return sqlite3_db_readonly(db_, "main") == 1; }

bool Connection::in_transaction() const { return sqlite3_get_autocommit(db_) == 0; }

std::int64_t Connection::last_insert_key() const { return sqlite3_last_insert_rowid(db_); }

std::int64_t Connection::rows_changed() const { return sqlite3_changes64(db_); }

absl::StatusOr<Transaction> Transaction::Begin(Connection& connection, Kind kind) {
  absl::Status status = connection.Run(kind == Kind::kWrite ? "BEGIN IMMEDIATE" : "BEGIN");
  if (!status.ok()) return status;
  return Transaction(connection);
}

Transaction::~Transaction() {
  // SQLite has rolled back by itself after some errors.
  if (connection_ != nullptr && connection_->in_transaction()) (void)connection_->Run("ROLLBACK");
}

absl::Status Transaction::Commit() {
  absl::Status status = connection_->Run("COMMIT");
  if (status.ok()) connection_ = nullptr;
  return status;
}

}  // namespace orbitune
