// The database's tables and the way from every earlier version of them to the present one.
#pragma once

#include <span>
#include <string_view>

#include "storage/sqlite_connection.h"

namespace orbitune {

// Migrations()[n] takes a database from version n (PRAGMA user_version) to n + 1. Released ones never change.
std::span<const std::string_view> Migrations();

// OK for an empty database, or for one of ours of a version <= `newest`; changes nothing. FAILED_PRECONDITION for a
// newer one or another program's, DATA_LOSS for no database at all.
absl::Status CheckSchema(Connection& connection, std::int64_t newest);

// Brings the database up to date, each migration in a transaction of its own: after an error it is at the last version
// that was reached. Errors as CheckSchema's and Connection's.
absl::Status Migrate(Connection& connection, std::span<const std::string_view> migrations);

}  // namespace orbitune
