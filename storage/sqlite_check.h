// Whether a database is sound: SQLite's own structures, and what our tables say of each other.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "storage/sqlite_connection.h"

namespace orbitune {

struct DatabaseSummary {
  std::int64_t schema_version = 0;
  std::int64_t bytes = 0;
  std::int64_t jobs = 0;
  std::int64_t unfinished_jobs = 0;
  std::int64_t iterations = 0;  // 0 where that is not quickly known: before version 1
  std::int64_t campaigns = 0;
  std::int64_t gain_sets = 0;
};

// "schema version 4, 12 jobs (1 unfinished), 4000 iterations, 2 campaigns, 9 gain sets, 3 MB".
std::string ToString(const DatabaseSummary& summary);

// Of a database of any version of ours. Errors: the connection's.
absl::StatusOr<DatabaseSummary> Summarise(Connection& connection);

// Reads everything. Faults as sentences, at most some twenty of a kind; none: the database is sound. Whether what the
// tables say of each other fits is asked of the present schema only. Errors: the connection's.
absl::StatusOr<std::vector<std::string>> FindFaults(Connection& connection);

// Reads the database's structure, the smaller tables first, until `limit` is over; false: then not all was read. 0: no
// limit. DATA_LOSS with the first fault; else errors as the connection's.
absl::StatusOr<bool> QuickCheck(Connection& connection, std::chrono::milliseconds limit);

}  // namespace orbitune
