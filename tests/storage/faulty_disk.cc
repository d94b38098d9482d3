#include "tests/storage/faulty_disk.h"

#include <sqlite3.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <mutex>
#include <thread>

namespace orbitune::storage_test {
namespace {

using Fault = FaultyDisk::Fault;
enum class Call { kWrite, kSync, kTruncate, kDelete, kCreate, kShare, kLock };

struct Plan {
  Fault fault = Fault::kNone;
  std::int64_t calls_before = 0;  // that still succeed
  FaultyDisk::Lasts lasts = FaultyDisk::Lasts::kUntilHealed;
  bool struck = false;
};
std::mutex plan_mutex;
Plan plan;  // guarded by plan_mutex

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

int IoError(Call call) {
  switch (call) {
    case Call::kWrite:
      return SQLITE_IOERR_WRITE;
    case Call::kSync:
      return SQLITE_IOERR_FSYNC;
    case Call::kTruncate:
      return SQLITE_IOERR_TRUNCATE;
    case Call::kDelete:
      return SQLITE_IOERR_DELETE;
    case Call::kCreate:
      return SQLITE_CANTOPEN;
    case Call::kShare:
      return SQLITE_IOERR_SHMSIZE;
    case Call::kLock:
      return SQLITE_BUSY;
  }
  return SQLITE_IOERR;
}

// What the fault makes of such a call; SQLITE_OK: nothing.
int ResultOf(Fault fault, Call call) {
  const bool needs_room = call == Call::kWrite || call == Call::kCreate || call == Call::kShare;
  switch (fault) {
    case Fault::kFull:
    case Fault::kShortWrite:
      return call == Call::kWrite ? SQLITE_FULL : needs_room ? IoError(call) : SQLITE_OK;
    case Fault::kWriteError:
      return call == Call::kSync || call == Call::kLock ? SQLITE_OK : IoError(call);
    case Fault::kSyncError:
      return call == Call::kSync ? IoError(call) : SQLITE_OK;
    case Fault::kReadOnly:
      return call == Call::kLock || call == Call::kSync ? SQLITE_OK
             : call == Call::kWrite                     ? SQLITE_READONLY
             : call == Call::kShare                     ? SQLITE_CANTOPEN
                                                        : IoError(call);
    case Fault::kLocked:
      return call == Call::kLock ? SQLITE_BUSY : SQLITE_OK;
    case Fault::kNone:
    case Fault::kSlow:
      return SQLITE_OK;
  }
  return SQLITE_OK;
}

// The fault that this call meets.
Fault Meet(Call call) {
  const std::lock_guard lock(plan_mutex);
  const Fault fault = plan.fault;
  if (fault == Fault::kNone || (call == Call::kLock) != (fault == Fault::kLocked)) return Fault::kNone;
  if (plan.calls_before > 0) {
    --plan.calls_before;
    return Fault::kNone;
  }
  if (plan.lasts == FaultyDisk::Lasts::kOneCall) plan.fault = Fault::kNone;
  plan.struck = true;
  return fault;
}

int Try(Call call) {
  const Fault fault = Meet(call);
  if (fault == Fault::kSlow) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  return ResultOf(fault, call);
}

int Write(sqlite3_file* file, const void* data, int size, sqlite3_int64 offset) {
  const Fault fault = Meet(Call::kWrite);
  if (fault == Fault::kShortWrite) (void)Real(file).xWrite(file, data, size / 2, offset);
  if (fault == Fault::kSlow) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  const int result = ResultOf(fault, Call::kWrite);
  return result == SQLITE_OK ? Real(file).xWrite(file, data, size, offset) : result;
}

int Sync(sqlite3_file* file, int flags) {
  const int result = Try(Call::kSync);
  return result == SQLITE_OK ? Real(file).xSync(file, flags) : result;
}

int Truncate(sqlite3_file* file, sqlite3_int64 size) {
  const int result = Try(Call::kTruncate);
  return result == SQLITE_OK ? Real(file).xTruncate(file, size) : result;
}

int Lock(sqlite3_file* file, int level) {
  const int result = level >= SQLITE_LOCK_RESERVED ? Try(Call::kLock) : SQLITE_OK;
  return result == SQLITE_OK ? Real(file).xLock(file, level) : result;
}

int ShmLock(sqlite3_file* file, int offset, int n, int flags) {
  constexpr int kWriteLock = 0;  // WAL_WRITE_LOCK
  const bool to_write = (flags & SQLITE_SHM_EXCLUSIVE) && (flags & SQLITE_SHM_LOCK) && offset == kWriteLock;
  const int result = to_write ? Try(Call::kLock) : SQLITE_OK;
  return result == SQLITE_OK ? Real(file).xShmLock(file, offset, n, flags) : result;
}

int ShmMap(sqlite3_file* file, int region, int size, int extend, void volatile** memory) {
  const int result = extend ? Try(Call::kShare) : SQLITE_OK;
  *memory = nullptr;
  return result == SQLITE_OK ? Real(file).xShmMap(file, region, size, extend, memory) : result;
}

const sqlite3_io_methods* WithFaults(const sqlite3_io_methods* real) {
  const std::lock_guard lock(methods_mutex);
  for (Methods& methods : all_methods) {
    if (methods.real == nullptr) {
      methods.faulty = *real;
      methods.faulty.xWrite = Write;
      methods.faulty.xSync = Sync;
      methods.faulty.xTruncate = Truncate;
      methods.faulty.xLock = Lock;
      methods.faulty.xShmLock = ShmLock;
      methods.faulty.xShmMap = ShmMap;
      methods.real = real;
    }
    if (methods.real == real) return &methods.faulty;
  }
  std::abort();
}

int OpenFile(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* flags_out) {
  const bool creates = name != nullptr && (flags & SQLITE_OPEN_CREATE) && access(name, F_OK) != 0;
  file->pMethods = nullptr;
  int result = creates ? Try(Call::kCreate) : SQLITE_OK;
  if (result == SQLITE_OK) result = real_vfs->xOpen(real_vfs, name, file, flags, flags_out);
  if (result == SQLITE_OK) file->pMethods = WithFaults(file->pMethods);
  return result;
}

int DeleteFile(sqlite3_vfs*, const char* name, int sync_directory) {
  const int result = access(name, F_OK) == 0 ? Try(Call::kDelete) : SQLITE_OK;
  return result == SQLITE_OK ? real_vfs->xDelete(real_vfs, name, sync_directory) : result;
}

}  // namespace

FaultyDisk::FaultyDisk() {
  Set(Fault::kNone);
  real_vfs = sqlite3_vfs_find(nullptr);
  faulty_vfs = *real_vfs;
  faulty_vfs.zName = "faulty";
  faulty_vfs.pNext = nullptr;
  faulty_vfs.xOpen = OpenFile;
  faulty_vfs.xDelete = DeleteFile;
  sqlite3_vfs_register(&faulty_vfs, /*makeDflt=*/1);
}

FaultyDisk::~FaultyDisk() {
  sqlite3_vfs_unregister(&faulty_vfs);
  sqlite3_vfs_register(real_vfs, /*makeDflt=*/1);
}

void FaultyDisk::Set(Fault fault) { SetAt(1, fault, Lasts::kUntilHealed); }

void FaultyDisk::SetAt(std::int64_t n, Fault fault, Lasts lasts) {
  const std::lock_guard lock(plan_mutex);
  plan = {.fault = fault, .calls_before = n - 1, .lasts = lasts, .struck = false};
}

void FaultyDisk::Heal() {
  const std::lock_guard lock(plan_mutex);
  plan.fault = Fault::kNone;
}

bool FaultyDisk::struck() const {
  const std::lock_guard lock(plan_mutex);
  return plan.struck;
}

}  // namespace orbitune::storage_test
