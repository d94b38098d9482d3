// A disk that fails when told to: SQLite's own file system layer with faults put in between.
#pragma once

namespace orbitune::storage_test {

// While one lives, databases opened by this process are on the faulty disk. One at a time; it must outlive them.
class FaultyDisk {
 public:
  enum class Fault { kNone, kFull, kWriteError, kSyncError };

  FaultyDisk();
  ~FaultyDisk();
  FaultyDisk(const FaultyDisk&) = delete;
  FaultyDisk& operator=(const FaultyDisk&) = delete;

  // From now on, for every file. Thread-safe.
  void Set(Fault fault);
};

}  // namespace orbitune::storage_test
