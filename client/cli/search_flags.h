// The options that choose and shape a search, to messages. Only the form is checked.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "orbitune/v1/tuning.pb.h"

namespace orbitune::cli {

// What is empty or unset is left to the server.
struct SearchFlags {
  std::string algorithm;  // ars, cma-es or nelder-mead
  std::optional<std::int64_t> max_episodes;
  std::optional<std::int32_t> plateau_iterations;
  std::optional<double> plateau_improvement;
  std::optional<std::int32_t> top_directions;
  std::string step_schedule;  // constant, linear or inverse-sqrt
  std::string exploration_schedule;
  bool log_gains = false;
  std::optional<std::int32_t> population;
  std::optional<double> initial_sigma;
  std::optional<double> population_growth;
  std::optional<double> initial_step;
  std::optional<std::int32_t> restarts;  // of the algorithm chosen; of both that have them where none is
};

// Errors name the option.
absl::Status SetSearch(const SearchFlags& flags, v1::Hyperparameters* parameters);

// "mean", "worst", "percentile:LEVEL" or "cvar:LEVEL".
absl::StatusOr<v1::Objective> ParseObjective(const std::string& text);

}  // namespace orbitune::cli
