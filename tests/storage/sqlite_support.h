// Shared by the tests of the SQLite store.
#pragma once

#include <memory>
#include <string>

#include "storage/job_store.h"
#include "storage/sqlite_connection.h"

namespace orbitune::storage_test {

// Fails the test, and returns null, where the store does not open.
std::unique_ptr<JobStore> OpenStore(const std::string& path);

absl::Status OpenError(const std::string& path);

// What an engineer with a shell of SQLite's own sees; fails the test if that is nothing.
std::int64_t QueryInt(const std::string& path, const std::string& sql);

std::string FileContents(const std::string& path);
void SetFileContents(const std::string& path, const std::string& contents);

}  // namespace orbitune::storage_test
