// Read-only connections, as many as there are reads at a time; a few are kept for the next ones.
#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "storage/sqlite_connection.h"

namespace orbitune {

// Thread-safe.
class SqliteReaderPool {
 public:
  explicit SqliteReaderPool(std::string path) : path_(std::move(path)) {}

  // Returns read(connection), run in one transaction: one state of the database, whatever is committed meanwhile.
  // Errors as the connection's and read's.
  template <typename Read>
  auto Run(const Read& read) -> decltype(read(std::declval<Connection&>())) {
    absl::StatusOr<std::unique_ptr<Connection>> connection = Take();
    if (!connection.ok()) return connection.status();
    auto result = RunIn(**connection, read);
    // After an error of SQLite's the next read had better begin with a new connection.
    if ((*connection)->failures() == 0) GiveBack(*std::move(connection));
    return result;
  }

 private:
  template <typename Read>
  static auto RunIn(Connection& connection, const Read& read) -> decltype(read(connection)) {
    const auto transaction = Transaction::Begin(connection, Transaction::Kind::kRead);
    if (!transaction.ok()) return transaction.status();
    return read(connection);
  }

  absl::StatusOr<std::unique_ptr<Connection>> Take();
  void GiveBack(std::unique_ptr<Connection> connection);

  const std::string path_;

  std::mutex mutex_;
  std::vector<std::unique_ptr<Connection>> free_;  // guarded by mutex_
};

}  // namespace orbitune
