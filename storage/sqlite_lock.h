// One server per database: a file beside it that the server keeps locked, with its process id in it.
#pragma once

#include <memory>
#include <string>

#include "core/base/status.h"

namespace orbitune {

// Held for its lifetime; the kernel frees it when the process ends, however it ends. The file stays.
class FileLock {
 public:
  // FAILED_PRECONDITION naming the other process where the lock is held; PERMISSION_DENIED, NOT_FOUND, INTERNAL with
  // the path where the file cannot be made or locked.
  static absl::StatusOr<std::unique_ptr<FileLock>> Take(const std::string& path);
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

 private:
  explicit FileLock(int fd) : fd_(fd) {}
  const int fd_;
};

}  // namespace orbitune
