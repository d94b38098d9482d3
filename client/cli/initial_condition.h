// The --ic option: a file, or key=value pairs whose keys tell the form (Keplerian, equinoctial or Cartesian).
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "orbitune/v1/orbit.pb.h"

namespace orbitune::cli {

// The keys are the field names of the form's message in orbit.proto. Every one of them must be there, once;
// only a Keplerian orbit's position may be left out (then it is the periapsis).
// A text without '=', or one ending in ".json", is the path of an OrbitState in JSON.
absl::StatusOr<v1::OrbitState> ParseInitialCondition(const std::string& text);

}  // namespace orbitune::cli
