// Provenance in the database: at a job's creation, while it runs, and of jobs that an earlier version stored without.
#pragma once

#include "storage/job.h"
#include "storage/sqlite_connection.h"

namespace orbitune {

// Of a job without iterations.
Provenance NewProvenance(const JobSpec& spec);

// Of its document and the newest digest. DATA_LOSS if these are none.
absl::StatusOr<Provenance> ReadProvenance(std::string_view document, std::string_view digest);

// Adds to what the document of the job with this key has.
absl::Status AddEngine(Connection& connection, std::int64_t job_key, const EngineStretch& stretch);

// Gives every job that has not ended and has no provenance one, with the digest of the iterations it has. Not within a
// transaction. Errors: the connection's; DATA_LOSS.
absl::Status BackfillProvenance(Connection& connection);

}  // namespace orbitune
