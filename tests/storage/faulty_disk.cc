#include "tests/storage/faulty_disk.h"

#include <sqlite3.h>

#include <array>
#include <atomic>
#include <cstdlib>
#include <mutex>

namespace orbitune::storage_test {
namespace {

std::atomic<FaultyDisk::Fault> fault{FaultyDisk::Fault::kNone};
sqlite3_vfs* real_vfs = nullptr;
sqlite3_vfs faulty_vfs;

// A set of methods of the real layer's files, and the same with faults (first, so that a file leads to it). The real
// layer has one for databases and one for logs.
struct Methods {
  sqlite3_io_methods faulty;
  const sqlite3_io_methods* real;
};
std::mutex methods_mutex;
std::array<Methods, 4> all_methods{};  // filled under methods_mutex, constant once filled

const sqlite3_io_methods& Real(const sqlite3_file* file) {
  return *reinterpret_cast<const Methods*>(file->pMethods)->real;
}

int Write(sqlite3_file* file, const void* data, int size, sqlite3_int64 offset) {
  if (fault == FaultyDisk::Fault::kFull) return SQLITE_FULL;
  if (fault == FaultyDisk::Fault::kWriteError) return SQLITE_IOERR_WRITE;
  return Real(file).xWrite(file, data, size, offset);
}

int Sync(sqlite3_file* file, int flags) {
  if (fault == FaultyDisk::Fault::kSyncError) return SQLITE_IOERR_FSYNC;
  return Real(file).xSync(file, flags);
}

const sqlite3_io_methods* WithFaults(const sqlite3_io_methods* real) {
  const std::lock_guard lock(methods_mutex);
  for (Methods& methods : all_methods) {
    if (methods.real == nullptr) {
      methods.faulty = *real;
      methods.faulty.xWrite = Write;
      methods.faulty.xSync = Sync;
      methods.real = real;
    }
    if (methods.real == real) return &methods.faulty;
  }
  std::abort();
}

int Open(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* flags_out) {
  const int result = real_vfs->xOpen(real_vfs, name, file, flags, flags_out);
  if (result == SQLITE_OK) file->pMethods = WithFaults(file->pMethods);
  return result;
}

}  // namespace

FaultyDisk::FaultyDisk() {
  Set(Fault::kNone);
  real_vfs = sqlite3_vfs_find(nullptr);
  faulty_vfs = *real_vfs;
  faulty_vfs.zName = "faulty";
  faulty_vfs.pNext = nullptr;
  faulty_vfs.xOpen = Open;
  sqlite3_vfs_register(&faulty_vfs, /*makeDflt=*/1);
}

FaultyDisk::~FaultyDisk() {
  sqlite3_vfs_unregister(&faulty_vfs);
  sqlite3_vfs_register(real_vfs, /*makeDflt=*/1);
}

void FaultyDisk::Set(Fault new_fault) { fault = new_fault; }

}  // namespace orbitune::storage_test
