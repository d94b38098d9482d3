// Copies of a database, beside a server that uses it or without one, and the way back.
#pragma once

#include <string>

#include "storage/sqlite_check.h"

namespace orbitune {

// Copies the database at `source`, as it is at one moment, to a new file `destination`: one that is whole, checked
// (FindFaults) and on disk before it has that name. Errors, with the path: NOT_FOUND, ALREADY_EXISTS for a destination
// that is there, FAILED_PRECONDITION for another program's database or a newer schema, DATA_LOSS where the source or
// the copy has faults, UNAVAILABLE where the disk fails. After an error there is no such file.
absl::StatusOr<DatabaseSummary> BackUpDatabase(const std::string& source, const std::string& destination);

struct Restored {
  DatabaseSummary summary;
  std::string kept;  // the path of the database that was there before; empty: none was
};

// Puts a copy of `backup`, checked first, in the place of `database`, which is kept under another name beside it.
// Errors as BackUpDatabase's, and then nothing has changed; FAILED_PRECONDITION while a server holds the database.
absl::StatusOr<Restored> RestoreDatabase(const std::string& backup, const std::string& database);

// In the database's directory: orbitune-WHAT-20260131T235959Z.db; of the present moment, not in use.
std::string NameBeside(const std::string& database, const std::string& what);

// Of what the server itself puts beside the database before it migrates it: "schema" and the version is WHAT.
std::string MigrationBackupName(const std::string& database, std::int64_t version);
// Those that are there, the newest last.
std::vector<std::string> MigrationBackupsBeside(const std::string& database);

// The path that a lock on the database is taken at.
std::string LockPathOf(const std::string& database);

}  // namespace orbitune
