// A thin owner of one SQLite connection: cached statements, typed binds, transactions, and errors as absl::Status.
// (SQLiteCpp tells every error by an exception and caches no statements; wrapping it would be as long as this.)
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "core/base/status.h"

struct sqlite3;
struct sqlite3_stmt;

namespace orbitune {

class Connection;

// One statement being run. Borrowed from its connection's cache or its own; reset or finalised at the end of its life.
// Must not outlive the connection; used by one thread at a time.
class Statement {
 public:
  using Value = std::variant<std::int64_t, double, std::string>;

  Statement(Statement&& other) noexcept;
  Statement& operator=(Statement&&) = delete;
  ~Statement();

  // Binds all parameters in order; texts and vectors are copied, a vector to a blob. NaN, nullopt and an empty optional
  // become NULL. An error shows at the next Step.
  template <typename... T>
  Statement& Bind(const T&... values) {
    int index = 0;
    (BindOne(++index, values), ...);
    return *this;
  }
  Statement& BindAll(std::span<const Value> values);

  // True: there is a row to read. Errors as Connection says.
  absl::StatusOr<bool> Step();

  // Steps to the end and ignores rows.
  absl::Status Run();

  // Calls visit() at every row, until it fails.
  absl::Status ForEachRow(const std::function<absl::Status()>& visit);

  // Of the present row; columns count from 0. NULL reads as 0, NaN and "".
  std::int64_t Int(int column) const;
  double Real(int column) const;
  std::string Text(int column) const;
  std::vector<double> Doubles(int column) const;  // of a blob; what is no whole double at its end is dropped
  bool IsNull(int column) const;
  bool IsNumberOrNull(int column) const;

 private:
  friend class Connection;
  Statement(Connection* connection, sqlite3_stmt* statement, bool cached)
      : connection_(connection), statement_(statement), cached_(cached) {}

  template <typename T>
  void BindOne(int index, const T& value) {
    if constexpr (std::is_same_v<T, std::nullopt_t>) {
      BindNull(index);
    } else if constexpr (std::is_integral_v<T>) {
      BindInt(index, value);
    } else if constexpr (std::is_floating_point_v<T>) {
      BindReal(index, value);
    } else {
      BindText(index, value);
    }
  }
  template <typename T>
  void BindOne(int index, const std::optional<T>& value) {
    value ? BindOne(index, *value) : BindNull(index);
  }
  void BindOne(int index, const std::vector<double>& value) { BindDoubles(index, value); }
  void BindNull(int index);
  void BindInt(int index, std::int64_t value);
  void BindReal(int index, double value);
  void BindText(int index, std::string_view value);
  void BindDoubles(int index, std::span<const double> value);
  void Note(int result);

  Connection* connection_;
  sqlite3_stmt* statement_;
  bool cached_;
  int bind_error_ = 0;
};

// Not thread-safe: one thread at a time. Errors: UNAVAILABLE where the disk, a lock or memory fails, and trying again
// may help; DATA_LOSS where the file is damaged or not a database; CANCELLED after Interrupt; INTERNAL for the rest.
class Connection {
 public:
  enum class Mode { kReadOnly, kReadWrite /* creates the file */ };

  // Opens path and sets what every connection of ours has: a busy timeout, foreign keys, checks of what is read.
  static absl::StatusOr<std::unique_ptr<Connection>> Open(const std::string& path, Mode mode);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  // From the cache; a statement's text must not be in use twice at a time.
  absl::StatusOr<Statement> Prepare(std::string_view sql);
  // For a text made for this one use.
  absl::StatusOr<Statement> PrepareOnce(std::string_view sql);

  // A cached statement without results.
  template <typename... T>
  absl::Status Run(std::string_view sql, const T&... values) {
    auto statement = Prepare(sql);
    return statement.ok() ? statement->Bind(values...).Run() : statement.status();
  }
  // The integer in the first row and column; NOT_FOUND if there is no row.
  absl::StatusOr<std::int64_t> QueryInt(std::string_view sql);
  // Several statements without parameters, uncached.
  absl::Status Execute(const std::string& script);

  // Makes this database a copy of another as it is at one moment, whoever writes to that meanwhile.
  absl::Status CopyFrom(Connection& source);

  // From any thread: ends the statement that runs.
  void Interrupt();

  const std::string& path() const { return path_; }
  bool read_only() const;
  bool in_transaction() const;
  std::int64_t last_insert_key() const;
  std::int64_t rows_changed() const;  // by the last statement
  // How many errors so far: whether a piece of work met one, whatever it made of it.
  std::int64_t failures() const { return failures_; }

 private:
  friend class Statement;
  Connection(std::string path, sqlite3* db) : path_(std::move(path)), db_(db) {}
  absl::StatusOr<sqlite3_stmt*> Compile(std::string_view sql, unsigned flags);
  absl::Status Error(int result);

  const std::string path_;
  sqlite3* const db_;
  std::map<std::string, sqlite3_stmt*, std::less<>> cache_;
  std::int64_t failures_ = 0;
};

// Rolls back at the end of its life unless committed. Must not outlive the connection.
class Transaction {
 public:
  enum class Kind { kRead, kWrite };
  static absl::StatusOr<Transaction> Begin(Connection& connection, Kind kind);
  Transaction(Transaction&& other) noexcept : connection_(std::exchange(other.connection_, nullptr)) {}
  Transaction& operator=(Transaction&&) = delete;
  ~Transaction();

  // On an error nothing of it is committed.
  absl::Status Commit();

 private:
  explicit Transaction(Connection& connection) : connection_(&connection) {}
  Connection* connection_;
};

}  // namespace orbitune
