// Initial conditions from a file: CSV with a column for each element, or JSON.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "orbitune/v1/campaign.pb.h"

namespace orbitune::cli {

// *.csv: a header with the names of one form's elements (those of --ic) in any order, then a row for each; the other
// columns of `orbitune campaign export` may be there, and only its rows of tuned initial conditions count. Else JSON:
// an array of OrbitState, or an InitialConditions. Errors name the file, the line and the column.
absl::StatusOr<v1::InitialConditions> ReadInitialConditions(const std::string& path);

// The same from text, as a CSV file has it.
absl::StatusOr<v1::InitialConditions> ParseInitialConditionsCsv(const std::string& text);

}  // namespace orbitune::cli
