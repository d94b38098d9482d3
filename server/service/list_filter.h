// The list filter and order of the public API: a small part of AIP-160 and AIP-132.
#pragma once

#include "storage/job_store.h"

namespace orbitune {

// Comparisons joined by AND; each is `state`, `scenario` or `labels.KEY`, then = or !=, then a word or a "quoted"
// text; or `text` and =, for what is somewhere in id, scenario, title or labels. Empty: everything. INVALID_ARGUMENT
// for field "filter", saying what was expected where.
absl::StatusOr<JobFilter> ParseFilter(std::string_view text);

// Likewise with `kind`, `scenario`, `job` and `campaign`, and = alone: sets what the query selects.
absl::Status ParseGainSetFilter(std::string_view text, GainSetQuery& query);

// "create_time" or "best_cost", each with or without " desc"; empty: "create_time desc". Sets query.order and
// query.descending.
absl::Status ParseOrder(std::string_view text, JobQuery& query);

}  // namespace orbitune
