// The tables of gain sets: writes, within the writer's transaction, and reads, within the reader's. Thread rule: the
// connection's.
#pragma once

#include <string>
#include <vector>

#include "storage/gain_store.h"
#include "storage/sqlite_connection.h"

namespace orbitune {

// An id that is taken is an error of the connection's. After one the transaction must be rolled back.
absl::Status InsertGainSet(Connection& connection, const GainSet& set);
// NOT_FOUND, with nothing written.
absl::Status RemoveGainSet(Connection& connection, const std::string& id);

// Errors: the connection's; DATA_LOSS, too, where what is read does not fit together; NOT_FOUND.
absl::StatusOr<GainSet> ReadGainSet(Connection& connection, const std::string& id);
absl::StatusOr<std::vector<GainSet>> ReadGainSets(Connection& connection, const GainSetQuery& query);
absl::Status ReadGainLibrary(Connection& connection, const GainStore::Shelf& shelf);

}  // namespace orbitune
