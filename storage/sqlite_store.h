// The JobStore in one SQLite database file: WAL, every commit on disk before it is answered, one server at a time.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "storage/job_store.h"
#include "storage/store_metrics.h"

namespace orbitune {

struct SqliteStoreOptions {
  std::string path;                 // of the database file; created if it is not there, its directory is not
  StoreMetrics* metrics = nullptr;  // outlives the store; nullptr: nothing is counted
  // Before a commit that failed is tried again; the pauses grow to 2 s.
  std::chrono::milliseconds first_retry_pause{50};

  enum class StartCheck {
    kAfterCrash,  // QuickCheck (storage/sqlite_check.h) where the last server did not close the database
    kFull,        // FindFaults
    kNone,
  };
  StartCheck start_check = StartCheck::kAfterCrash;
  std::chrono::milliseconds start_check_limit{10'000};  // of kAfterCrash
  // Is told of what takes long or was found, a sentence each; empty: nobody is.
  std::function<void(const std::string&)> log;
};

// Opens the database, checks it, brings its schema up to date, with a backup beside it before that, and starts the
// writer. Errors name the path and what is wrong:
//   NOT_FOUND            there is no such directory
//   FAILED_PRECONDITION  its parent is not a directory; another server has it; another program's or a newer schema
//                        (then nothing in it is changed); a file system without shared memory
//   PERMISSION_DENIED    the directory or the file cannot be written
//   DATA_LOSS            not a database, or damaged; says what can be done
//   UNAVAILABLE          the disk fails, or another process locks the file; the backup before a migration cannot be
//                        written (then nothing is changed)
absl::StatusOr<std::unique_ptr<JobStore>> OpenSqliteStore(const SqliteStoreOptions& options);

}  // namespace orbitune
