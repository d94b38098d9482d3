#include "storage/sqlite_reader_pool.h"

namespace orbitune {
namespace {

constexpr std::size_t kMostKept = 8;

}  // namespace

absl::StatusOr<std::unique_ptr<Connection>> SqliteReaderPool::Take() {
  {
    const std::lock_guard lock(mutex_);
    if (!free_.empty()) {
      std::unique_ptr<Connection> connection = std::move(free_.back());
      free_.pop_back();
      return connection;
    }
  }
  return Connection::Open(path_, Connection::Mode::kReadOnly);
}

void SqliteReaderPool::GiveBack(std::unique_ptr<Connection> connection) {
  const std::lock_guard lock(mutex_);
  if (free_.size() < kMostKept) free_.push_back(std::move(connection));
}

}  // namespace orbitune
