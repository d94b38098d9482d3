#include "client/cli/search_flags.h"

#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "client/cli/number.h"

namespace orbitune::cli {
namespace {

// "cma-es" to ALGORITHM_CMA_ES and so on.
template <typename E>
absl::Status ParseEnum(const char* option, const std::string& text, const char* prefix, const char* allowed,
                       bool (*parse)(const std::string&, E*), E* out) {
  const std::string name = absl::StrCat(prefix, absl::StrReplaceAll(absl::AsciiStrToUpper(text), {{"-", "_"}}));
  if (text != "unspecified" && parse(name, out)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(option, ": must be ", allowed, ", got '", text, "'"));
}

bool ParseAlgorithm(const std::string& name, v1::Algorithm* out) { return v1::Algorithm_Parse(name, out); }
bool ParseSchedule(const std::string& name, v1::Schedule* out) { return v1::Schedule_Parse(name, out); }

absl::Status SetSchedule(const char* option, const std::string& text, void (v1::ArsVariants::*set)(v1::Schedule),
                         v1::Hyperparameters* parameters) {
  if (text.empty()) return absl::OkStatus();
  v1::Schedule schedule = v1::SCHEDULE_UNSPECIFIED;
  const absl::Status status =
      ParseEnum(option, text, "SCHEDULE_", "constant, linear or inverse-sqrt", &ParseSchedule, &schedule);
  if (status.ok()) (parameters->mutable_ars_variants()->*set)(schedule);
  return status;
}

void SetRestarts(std::int32_t restarts, v1::Hyperparameters* parameters) {
  if (parameters->algorithm() != v1::ALGORITHM_NELDER_MEAD) parameters->mutable_cma_es()->set_restarts(restarts);
  if (parameters->algorithm() != v1::ALGORITHM_CMA_ES) parameters->mutable_nelder_mead()->set_restarts(restarts);
}

}  // namespace

absl::Status SetSearch(const SearchFlags& flags, v1::Hyperparameters* parameters) {
  absl::Status status;
  if (!flags.algorithm.empty()) {
    v1::Algorithm algorithm = v1::ALGORITHM_UNSPECIFIED;
    status = ParseEnum("--algorithm", flags.algorithm, "ALGORITHM_", "ars, cma-es or nelder-mead", &ParseAlgorithm,
                       &algorithm);
    parameters->set_algorithm(algorithm);
  }
  if (flags.max_episodes) parameters->set_max_episodes(*flags.max_episodes);
  if (flags.plateau_iterations) parameters->mutable_plateau_stop()->set_iterations(*flags.plateau_iterations);
  if (flags.plateau_improvement) parameters->mutable_plateau_stop()->set_min_improvement(*flags.plateau_improvement);
  if (flags.top_directions) parameters->mutable_ars_variants()->set_top_directions(*flags.top_directions);
  if (flags.log_gains) parameters->mutable_ars_variants()->set_log_gains(true);
  if (flags.population) parameters->mutable_cma_es()->set_population(*flags.population);
  if (flags.initial_sigma) parameters->mutable_cma_es()->set_initial_sigma(*flags.initial_sigma);
  if (flags.population_growth) parameters->mutable_cma_es()->set_population_growth(*flags.population_growth);
  if (flags.initial_step) parameters->mutable_nelder_mead()->set_initial_step(*flags.initial_step);
  if (flags.restarts) SetRestarts(*flags.restarts, parameters);
  status.Update(SetSchedule("--step-schedule", flags.step_schedule, &v1::ArsVariants::set_step_schedule, parameters));
  status.Update(SetSchedule("--exploration-schedule", flags.exploration_schedule,
                            &v1::ArsVariants::set_exploration_schedule, parameters));
  return status;
}

absl::StatusOr<v1::Objective> ParseObjective(const std::string& text) {
  const std::vector<std::string> parts = absl::StrSplit(text, absl::MaxSplits(':', 1));
  const bool levelled = parts[0] == "percentile" || parts[0] == "cvar";
  v1::Aggregate aggregate = v1::AGGREGATE_UNSPECIFIED;
  const bool known = parts[0] != "unspecified" &&
                     v1::Aggregate_Parse(absl::StrCat("AGGREGATE_", absl::AsciiStrToUpper(parts[0])), &aggregate);
  if (!known || levelled != (parts.size() == 2)) {
    return absl::InvalidArgumentError(
        absl::StrCat("must be mean, worst, percentile:LEVEL or cvar:LEVEL, with LEVEL in (0, 1), got '", text, "'"));
  }
  v1::Objective objective;
  objective.set_aggregate(aggregate);
  if (!levelled) return objective;
  const auto level = ParseNumber<double>(parts[1]);
  if (!level.ok()) return level.status();
  objective.set_level(*level);
  return objective;
}

}  // namespace orbitune::cli
