// Reads of a job and its history from one connection, each within the caller's transaction: what several of them return
// in one transaction belongs together. Thread rule: the connection's. Errors: the connection's; DATA_LOSS, too, where
// what is read does not fit together; NOT_FOUND for an unknown job.
#pragma once

#include <string>
#include <vector>

#include "storage/job_store.h"
#include "storage/sqlite_connection.h"
#include "storage/sqlite_list_query.h"

namespace orbitune {

absl::Status JobNotFound(const std::string& id);

// With its report, if it has one.
absl::StatusOr<JobRecord> ReadJob(Connection& connection, const std::string& id);

// Without reports.
absl::StatusOr<std::vector<JobRecord>> ReadJobs(Connection& connection, const ListQuery& query);

// Iterations `first`, first + 1, ... that there are of the job with this key, at most `count`.
absl::StatusOr<std::vector<IterationRecord>> ReadIterations(Connection& connection, std::int64_t job_key,
                                                            std::int64_t first, std::int64_t count);

// As JobStore::ListIterations, JobStore::SampleIterations and JobStore::ListEvents.
absl::StatusOr<std::vector<IterationRecord>> ReadIterationsOf(Connection& connection, const std::string& id,
                                                              int after_iteration, int limit);
absl::StatusOr<std::vector<IterationRecord>> SampleIterationsOf(Connection& connection, const std::string& id,
                                                                IterationRange range, int max_points);
absl::StatusOr<std::vector<JobEvent>> ReadEventsOf(Connection& connection, const std::string& id,
                                                   std::int64_t after_seq, int limit);

}  // namespace orbitune
