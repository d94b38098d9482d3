#include "client/cli/submission.h"

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "client/cli/files.h"
#include "client/cli/initial_condition.h"
#include "client/cli/initial_condition_file.h"
#include "client/cli/parse.h"
#include "orbitune/v1/gains.pb.h"
#include "orbitune/v1/simulation.pb.h"

namespace orbitune::cli {
namespace {

// The same error, telling the option it came from.
absl::Status For(const char* option, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat(option, ": ", status.message()));
}

absl::Status SetGains(const char* option, const std::string& text, v1::Gains* gains) {
  const absl::StatusOr<v1::Gains> parsed = ParseGains(text);
  if (!parsed.ok()) return For(option, parsed.status());
  *gains = *parsed;
  return absl::OkStatus();
}

absl::Status SetHyperparameters(const SubmitOptions& options, v1::Hyperparameters* parameters) {
  if (options.iterations) parameters->set_iterations(*options.iterations);
  if (options.step_size) parameters->set_step_size(*options.step_size);
  if (options.exploration_scale) parameters->set_exploration_scale(*options.exploration_scale);
  if (options.directions) parameters->set_directions(*options.directions);
  if (options.gain_floor) parameters->set_gain_floor(*options.gain_floor);
  if (options.seed) parameters->set_seed(*options.seed);
  absl::Status status = SetSearch(options.search, parameters);
  if (status.ok() && !options.initial_gains.empty()) {
    status = SetGains("--initial-gains", options.initial_gains, parameters->mutable_initial_gains());
  }
  if (status.ok() && !options.exploration_std.empty()) {
    status = SetGains("--exploration-std", options.exploration_std, parameters->mutable_exploration_std());
  }
  return status;
}

absl::Status SetEnsemble(const SubmitOptions& options, v1::Job* job) {
  if (!options.initial_conditions_file.empty()) {
    const auto listed = ReadInitialConditions(options.initial_conditions_file);
    if (!listed.ok()) return For("--ics", listed.status());
    *job->mutable_initial_conditions() = listed->list();
  }
  if (!options.objective.empty()) {
    const auto objective = ParseObjective(options.objective);
    if (!objective.ok()) return For("--objective", objective.status());
    *job->mutable_objective() = *objective;
  }
  if (options.relative) job->mutable_objective()->set_relative_to_initial(true);
  return absl::OkStatus();
}

std::string Quoted(const std::string& value) {
  return absl::StrCat("\"", absl::StrReplaceAll(value, {{"\\", "\\\\"}, {"\"", "\\\""}}), "\"");
}

}  // namespace

template <typename Message>
absl::Status SetFlight(const FlightOptions& options, Message* message) {
  if (!options.scenario.empty()) message->set_scenario(ResourceName("scenarios", options.scenario));
  if (!options.scenario_file.empty()) {
    const absl::Status status = ReadJsonFile(options.scenario_file, message->mutable_scenario_definition());
    if (!status.ok()) return For("--scenario-file", status);
  }
  if (!options.initial_condition.empty()) {
    const absl::StatusOr<v1::OrbitState> state = ParseInitialCondition(options.initial_condition);
    if (!state.ok()) return For("--ic", state.status());
    *message->mutable_initial_condition() = *state;
  }
  return absl::OkStatus();
}

template absl::Status SetFlight(const FlightOptions& options, v1::Job* message);
template absl::Status SetFlight(const FlightOptions& options, v1::SimulateEpisodeRequest* message);
template absl::Status SetFlight(const FlightOptions& options, v1::QueryGainsRequest* message);

absl::StatusOr<v1::CreateJobRequest> BuildCreateJobRequest(const SubmitOptions& options) {
  if (options.flight.scenario.empty() && options.flight.scenario_file.empty()) {
    return absl::InvalidArgumentError(
        "a scenario is required: --scenario NAME (`orbitune scenarios` lists them) or --scenario-file FILE");
  }
  v1::CreateJobRequest request;
  v1::Job& job = *request.mutable_job();
  if (const absl::Status status = SetFlight(options.flight, &job); !status.ok()) return status;
  job.set_display_name(options.display_name);
  job.set_priority(options.priority);
  for (const std::string& label : options.labels) {
    const auto pair = ParsePair(label);
    if (!pair.ok()) return For("--label", pair.status());
    if (!job.mutable_labels()->insert({pair->first, pair->second}).second) {
      return absl::InvalidArgumentError(absl::StrCat("--label: '", pair->first, "' is given twice"));
    }
  }
  absl::Status status = SetHyperparameters(options, job.mutable_hyperparameters());
  if (status.ok()) status = SetEnsemble(options, &job);
  if (!status.ok()) return status;
  job.set_warm_start(options.warm_start);
  request.set_request_id(options.request_id.empty() ? RandomUuid() : options.request_id);
  request.set_validate_only(options.validate_only);
  return request;
}

absl::StatusOr<std::string> BuildFilter(const JobsOptions& options) {
  std::vector<std::string> terms;
  if (!options.filter.empty()) terms.push_back(options.filter);
  if (!options.state.empty()) {
    const std::string upper = absl::AsciiStrToUpper(options.state);
    terms.push_back(absl::StrCat("state = ", absl::StripPrefix(upper, "JOB_STATE_")));
  }
  if (!options.scenario.empty()) {
    terms.push_back(
        absl::StrCat("scenario = ", Quoted(std::string(absl::StripPrefix(options.scenario, "scenarios/")))));
  }
  for (const std::string& label : options.labels) {
    const auto pair = ParsePair(label);
    if (!pair.ok()) return For("--label", pair.status());
    terms.push_back(absl::StrCat("labels.", pair->first, " = ", Quoted(pair->second)));
  }
  return absl::StrJoin(terms, " AND ");
}

}  // namespace orbitune::cli
