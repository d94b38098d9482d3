#include "tests/storage/sqlite_support.h"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "storage/sqlite_store.h"

namespace orbitune::storage_test {

std::unique_ptr<JobStore> OpenStore(const std::string& path) {
  auto store = OpenSqliteStore({.path = path});
  EXPECT_TRUE(store.ok()) << store.status();
  return store.ok() ? *std::move(store) : nullptr;
}

absl::Status OpenError(const std::string& path) { return OpenSqliteStore({.path = path}).status(); }

std::int64_t QueryInt(const std::string& path, const std::string& sql) {
  auto connection = Connection::Open(path, Connection::Mode::kReadOnly);
  if (!connection.ok()) {
    ADD_FAILURE() << connection.status();
    return -1;
  }
  const auto value = (*connection)->QueryInt(sql);
  EXPECT_TRUE(value.ok()) << value.status();
  return value.value_or(-1);
}

std::string FileContents(const std::string& path) {
  std::ostringstream contents;
  contents << std::ifstream(path, std::ios::binary).rdbuf();
  return contents.str();
}

void SetFileContents(const std::string& path, const std::string& contents) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << contents;
}

}  // namespace orbitune::storage_test
