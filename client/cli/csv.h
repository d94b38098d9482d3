// The CSV tables: units in the headers, doubles that round-trip, nothing that would need quotes.
#pragma once

#include <string>

#include "orbitune/v1/simulation.pb.h"
#include "orbitune/v1/tuning.pb.h"

namespace orbitune::cli {

// Lines without their end.
std::string IterationCsvHeader();
std::string IterationCsvRow(const v1::Iteration& iteration);  // an unset cost is an empty field
std::string TrajectoryCsvHeader();
std::string TrajectoryCsvRow(const v1::TrajectorySample& sample);  // the elements are the chaser's

}  // namespace orbitune::cli
