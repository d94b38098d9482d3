// Command line options to request messages, reading local files on the way.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/commands.h"
#include "orbitune/v1/tuning.pb.h"

namespace orbitune::cli {

// Fills scenario or scenario_definition, and initial_condition: for Job, SimulateEpisodeRequest and QueryGainsRequest
// alike.
template <typename Message>
absl::Status SetFlight(const FlightOptions& options, Message* message);

// The request, with a random request_id where none is given.
absl::StatusOr<v1::CreateJobRequest> BuildCreateJobRequest(const SubmitOptions& options);

// ListJobsRequest.filter: --filter and the shorthands, joined by AND.
absl::StatusOr<std::string> BuildFilter(const JobsOptions& options);

}  // namespace orbitune::cli
