// A JobQuery as SQL: a text with parameters, and their values.
#pragma once

#include <string>
#include <vector>

#include "storage/job_store.h"
#include "storage/sqlite_connection.h"

namespace orbitune {

struct ListQuery {
  std::string tail;  // of a SELECT ... FROM jobs: from WHERE to LIMIT
  std::vector<Statement::Value> values;
};

// The page in one or two stretches, to be read one after another until it is full: by best cost, the jobs without one
// follow those with one in either direction, and each stretch is in the order of an index.
std::vector<ListQuery> MakeListQueries(const JobQuery& query);

// In kQueued, kRunning or kPaused, oldest first.
ListQuery MakeUnfinishedQuery();

}  // namespace orbitune
