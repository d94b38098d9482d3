// A disk that fails when told to: SQLite's own file system layer with faults put in between.
#pragma once

#include <cstdint>

namespace orbitune::storage_test {

// While one lives, databases opened by this process are on the faulty disk. One at a time; it must outlive them.
//
// Counted are the calls that change a file or make sure that it is on disk: writes, syncs, truncations, deletions, the
// creation of a file and of the shared memory beside it, and (Fault::kLocked only) locks to write.
class FaultyDisk {
 public:
  enum class Fault {
    kNone,
    kFull,        // what would need room finds none
    kWriteError,  // an I/O error in all but syncs
    kSyncError,   // an I/O error in syncs alone
    kShortWrite,  // the first half of what is written gets there, then the disk is full
    kReadOnly,    // nothing can be changed
    kLocked,      // another process has the locks
    kSlow,        // every call takes a while, and succeeds
  };
  enum class Lasts { kOneCall, kUntilHealed };

  FaultyDisk();
  ~FaultyDisk();
  FaultyDisk(const FaultyDisk&) = delete;
  FaultyDisk& operator=(const FaultyDisk&) = delete;

  // All thread-safe, and for every file.

  // From now on.
  void Set(Fault fault);
  // At the n-th call from now, n from 1.
  void SetAt(std::int64_t n, Fault fault, Lasts lasts);
  // Nothing fails any more.
  void Heal();
  // Whether a call has failed since the fault was set, healed meanwhile or not.
  bool struck() const;
};

}  // namespace orbitune::storage_test
