// `orbitune simulate`: one episode, in words, and its trajectory as CSV.
#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/commands.h"
#include "client/cli/csv.h"
#include "client/cli/errors.h"
#include "client/cli/files.h"
#include "client/cli/format.h"
#include "client/cli/json.h"
#include "client/cli/parse.h"
#include "client/cli/session.h"
#include "client/cli/submission.h"

namespace orbitune::cli {
namespace {

// The gains of a job that `which` names, from its report or, before there is one, from its iterations.
const v1::Gains* PickGains(const v1::Job& job, const std::string& which) {
  const bool report = job.has_report();
  if (which == "initial") return report ? &job.report().initial().gains() : &job.hyperparameters().initial_gains();
  if (which == "final") {
    if (report) return &job.report().final().gains();
    return job.has_latest_iteration() ? &job.latest_iteration().gains() : nullptr;
  }
  if (report) return &job.report().best().gains();
  return job.has_best_iteration() ? &job.best_iteration().gains() : nullptr;
}

grpc::Status SetFromJob(const Session& session, const SimulateOptions& options, v1::SimulateEpisodeRequest* request) {
  v1::GetJobRequest get;
  get.set_name(ResourceName("jobs", options.job));
  v1::Job job;
  grpc::Status status = session.Call(&v1::TuningService::Stub::GetJob, get, &job);
  if (!status.ok()) return status;
  *request->mutable_scenario_definition() = job.scenario_definition();
  if (job.has_initial_condition()) *request->mutable_initial_condition() = job.initial_condition();
  const v1::Gains* const gains = PickGains(job, options.which);
  if (gains == nullptr) {
    return grpc::Status(grpc::StatusCode::FAILED_PRECONDITION,
                        absl::StrCat(job.name(), " has no ", options.which, " gains yet"));
  }
  *request->mutable_gains() = *gains;
  return status;
}

grpc::Status BuildRequest(const Session& session, const SimulateOptions& options, v1::SimulateEpisodeRequest* request) {
  if (options.job.empty() && options.flight.scenario.empty() && options.flight.scenario_file.empty()) {
    return {grpc::StatusCode::INVALID_ARGUMENT, "one of --scenario, --scenario-file and --job is required"};
  }
  if (!options.job.empty()) {
    grpc::Status status = SetFromJob(session, options, request);
    if (!status.ok()) return status;
  }
  if (const absl::Status status = SetFlight(options.flight, request); !status.ok()) return ToGrpcStatus(status);
  if (!options.gains.empty()) {
    const absl::StatusOr<v1::Gains> gains = ParseGains(options.gains);
    if (!gains.ok()) return {grpc::StatusCode::INVALID_ARGUMENT, absl::StrCat("--gains: ", gains.status().message())};
    *request->mutable_gains() = *gains;
  }
  request->set_early_exit(options.early_exit);
  request->set_include_trajectory(!options.csv.empty() || options.trajectory);
  request->set_sample_stride(options.stride);
  return grpc::Status::OK;
}

void PrintResult(const v1::EpisodeResult& result, std::ostream& out) {
  const auto line = [&](const char* title, const std::string& text) {
    out << absl::StrFormat("%-24s %s\n", title, text);
  };
  line("outcome", OutcomeText(result.outcome()));
  if (!result.outcome_message().empty()) line("", Printable(result.outcome_message()));
  if (result.has_cost()) {
    line("cost J", Human(result.cost()));
    line("settling time",
         absl::StrFormat("%d samples, %s h", result.settling_samples(), Human(result.settling_time_s() / 3600)));
    line("fuel sum", Human(result.fuel_sum()) + " (in the scenario's acceleration unit)");
    line("delta-v to settling", Human(result.delta_v_to_settling_m_s()) + " m/s");
  }
  if (result.has_delta_v_horizon_m_s()) line("delta-v over horizon", Human(result.delta_v_horizon_m_s()) + " m/s");
  line("peak acceleration", Human(result.peak_acceleration_m_s2()) + " m/s^2");
  line("simulated time", Human(result.end_time_s() / 3600) + " h");
  line("initial Lyapunov value", Human(result.initial_lyapunov()));
  line("stays in the domain", GuaranteeText(result.domain_guarantee()));
}

void WriteTrajectory(const v1::SimulateEpisodeResponse& response, std::ostream& out) {
  out << TrajectoryCsvHeader() << '\n';
  for (const v1::TrajectorySample& sample : response.trajectory()) out << TrajectoryCsvRow(sample) << '\n';
}

}  // namespace

int RunSimulate(Session& session, const SimulateOptions& options) {
  v1::SimulateEpisodeRequest request;
  grpc::Status status = BuildRequest(session, options, &request);
  if (!status.ok()) return session.Fail(status);
  v1::SimulateEpisodeResponse response;
  status = session.Call(&v1::SimulationService::Stub::SimulateEpisode, request, &response);
  if (!status.ok()) return session.Fail(status);

  const bool to_stdout = options.csv == "-";
  if (to_stdout) {
    WriteTrajectory(response, session.out());
  } else if (!options.csv.empty()) {
    OutputFile file(options.csv);
    if (file.status().ok()) WriteTrajectory(response, file.stream());
    const absl::Status written = file.status().ok() ? file.Commit() : file.status();
    if (!written.ok()) return session.Fail(written);
  }
  if (!options.trajectory) response.clear_trajectory();
  std::ostream& words = to_stdout ? session.err() : session.out();
  if (session.json()) {
    words << JsonLine(response);
  } else {
    PrintResult(response.result(), words);
  }
  return response.result().has_cost() ? kExitOk : kExitUnsuccessful;
}

}  // namespace orbitune::cli
