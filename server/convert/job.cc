#include "server/convert/job.h"

#include <cmath>
#include <numbers>

#include "absl/strings/str_cat.h"
#include "server/convert/number.h"
#include "server/convert/provenance.h"

namespace orbitune {
namespace {

constexpr double kDegreesPerRadian = 180 / std::numbers::pi;

v1::WarningKind ToProto(WarningKind kind) {
  switch (kind) {
    case WarningKind::kGainAtFloor:
      return v1::WARNING_KIND_GAIN_AT_FLOOR;
    case WarningKind::kLastNotBest:
      return v1::WARNING_KIND_LAST_NOT_BEST;
    case WarningKind::kPeakAcceleration:
      return v1::WARNING_KIND_PEAK_ACCELERATION;
    case WarningKind::kNotSettled:
      return v1::WARNING_KIND_NOT_SETTLED;
    case WarningKind::kDeltaVRose:
      return v1::WARNING_KIND_DELTA_V_ROSE;
    case WarningKind::kPairsLeftOut:
      return v1::WARNING_KIND_PAIRS_LEFT_OUT;
  }
  return v1::WARNING_KIND_UNSPECIFIED;
}

double ReductionPercent(double before, double after) {
  return before > 0 && !std::isnan(after) ? 100 * (1 - after / before) : 0;
}

void SetReduction(const EpisodeReport& before, const EpisodeReport& after, v1::Reduction* out) {
  out->set_cost_percent(ReductionPercent(before.cost, after.cost));
  out->set_settling_time_percent(ReductionPercent(before.settling_samples, after.settling_samples));
  out->set_fuel_sum_percent(ReductionPercent(before.fuel_sum, after.fuel_sum));
  out->set_delta_v_percent(ReductionPercent(before.delta_v_to_settling_m_s, after.delta_v_to_settling_m_s));
  out->set_peak_acceleration_percent(ReductionPercent(before.peak_acceleration_m_s2, after.peak_acceleration_m_s2));
}

void ToProto(const Spread& spread, v1::EnsembleResult::Spread* out) {
  out->set_mean(OrZero(spread.mean));
  out->set_min(OrZero(spread.min));
  out->set_max(OrZero(spread.max));
}

void ToProto(const GainsAssessment& assessed, v1::GainsAssessment* out) {
  out->set_iteration(assessed.iteration);
  orbitune::ToProto(assessed.gains, out->mutable_gains());
  orbitune::ToProto(assessed.episode, out->mutable_result());
  if (!assessed.ensemble) return;
  const EnsembleReport& e = *assessed.ensemble;
  v1::EnsembleResult* ensemble = out->mutable_ensemble();
  ensemble->set_initial_conditions(e.initial_conditions);
  ensemble->set_settled(e.settled);
  if (!std::isnan(e.objective)) ensemble->set_objective(e.objective);
  ToProto(e.cost, ensemble->mutable_cost());
  ToProto(e.cost_reduction_percent, ensemble->mutable_cost_reduction_percent());
  ToProto(e.settling_time_reduction_percent, ensemble->mutable_settling_time_reduction_percent());
  ToProto(e.fuel_sum_reduction_percent, ensemble->mutable_fuel_sum_reduction_percent());
}

void ToProto(const EquinoctialElements& canonical, double length_km, v1::EquinoctialElements* out) {
  out->set_p_km(canonical.p * length_km);
  out->set_ex(canonical.ex);
  out->set_ey(canonical.ey);
  out->set_hx(canonical.hx);
  out->set_hy(canonical.hy);
  out->set_true_longitude_deg(canonical.true_longitude * kDegreesPerRadian);
}

void ToProto(const EpisodeSample& sample, const PreparedScenario& prepared, v1::TrajectorySample* out) {
  const CanonicalUnits& units = prepared.units;
  const TargetOrbit& target = prepared.problem.target;
  out->set_sample(sample.sample);
  out->set_time_s(sample.sample * prepared.problem.sampling_period * units.time_s);
  ToProto(ChaserElements(sample.error, target, sample.target_longitude), units.length_km, out->mutable_chaser());
  ToProto({.true_longitude = sample.target_longitude,
           .p = 1,
           .ex = target.ex,
           .ey = target.ey,
           .hx = target.hx,
           .hy = target.hy},
          units.length_km, out->mutable_target());
  v1::ErrorCoordinates* x = out->mutable_error();
  x->set_x1(sample.error.x1);
  x->set_x2(sample.error.x2);
  x->set_x3(sample.error.x3);
  x->set_x4(sample.error.x4);
  x->set_x5(sample.error.x5);
  x->set_x6(sample.error.x6);
  out->mutable_control()->set_radial_m_s2(sample.control.radial * units.acceleration_m_s2());
  out->mutable_control()->set_transverse_m_s2(sample.control.transverse * units.acceleration_m_s2());
  out->mutable_control()->set_normal_m_s2(sample.control.normal * units.acceleration_m_s2());
  out->set_lyapunov(sample.lyapunov);
  out->set_distance_km(sample.distance * units.length_km);
}

}  // namespace

v1::Outcome ToProto(Outcome outcome) {
  switch (outcome) {
    case Outcome::kSettled:
      return v1::OUTCOME_SETTLED;
    case Outcome::kNotSettled:
      return v1::OUTCOME_NOT_SETTLED;
    case Outcome::kLeftDomain:
      return v1::OUTCOME_LEFT_DOMAIN;
    case Outcome::kNumericalFailure:
      return v1::OUTCOME_NUMERICAL_FAILURE;
  }
  return v1::OUTCOME_UNSPECIFIED;
}

void SetTime(TimeUs time_us, google::protobuf::Timestamp* out) {
  out->set_seconds(time_us / 1'000'000);
  out->set_nanos(static_cast<int>(time_us % 1'000'000) * 1000);
}

absl::StatusOr<ScenarioChoice> ChoiceFromProto(const std::string& name, bool has_definition,
                                               const v1::Scenario& definition) {
  ScenarioChoice choice;
  if (!name.empty()) {
    auto id = IdFromName("scenarios", name, "scenario");
    if (!id.ok()) return id.status();
    choice.preset_id = *id;
  }
  if (has_definition) {
    auto scenario = FromProto(definition);
    if (!scenario.ok()) return scenario.status();
    choice.definition = *std::move(scenario);
  }
  return choice;
}

v1::JobState ToProto(JobState state) {
  switch (state) {
    case JobState::kQueued:
      return v1::JOB_STATE_QUEUED;
    case JobState::kRunning:
      return v1::JOB_STATE_RUNNING;
    case JobState::kPaused:
      return v1::JOB_STATE_PAUSED;
    case JobState::kSucceeded:
      return v1::JOB_STATE_SUCCEEDED;
    case JobState::kFailed:
      return v1::JOB_STATE_FAILED;
    case JobState::kCancelled:
      return v1::JOB_STATE_CANCELLED;
  }
  return v1::JOB_STATE_UNSPECIFIED;
}

absl::StatusOr<NewJob> FromProto(const v1::Job& job) {
  NewJob created;
  created.display_name = job.display_name();
  created.labels = {job.labels().begin(), job.labels().end()};
  created.priority = job.priority();
  auto scenario = ChoiceFromProto(job.scenario(), job.has_scenario_definition(), job.scenario_definition());
  if (!scenario.ok()) {
    FieldErrors errors;
    errors.Merge("job", scenario.status());
    return errors.ToStatus();
  }
  created.scenario = *std::move(scenario);
  created.initial_condition = FromProto(job.initial_condition());
  for (const v1::OrbitState& state : job.initial_conditions()) created.initial_conditions.push_back(FromProto(state));
  created.warm_start = job.warm_start();
  FieldErrors errors;
  if (auto objective = FromProto(job.objective()); objective.ok()) {
    created.objective = *objective;
  } else {
    errors.Merge("job.objective", objective.status());
  }
  if (auto search = FromProto(job.hyperparameters()); search.ok()) {
    created.search = *search;
  } else {
    errors.Merge("job.hyperparameters", search.status());
  }
  if (!errors.empty()) return errors.ToStatus();
  return created;
}

absl::StatusOr<EpisodeRequest> FromProto(const v1::SimulateEpisodeRequest& request) {
  EpisodeRequest episode;
  auto scenario = ChoiceFromProto(request.scenario(), request.has_scenario_definition(), request.scenario_definition());
  if (!scenario.ok()) return scenario.status();
  episode.scenario = *std::move(scenario);
  episode.initial_condition = FromProto(request.initial_condition());
  if (request.has_gains()) episode.gains = FromProto(request.gains());
  episode.early_exit = request.early_exit();
  episode.include_trajectory = request.include_trajectory();
  episode.sample_stride = request.sample_stride();
  return episode;
}

void ToProto(const IterationRecord& record, v1::Iteration* out) {
  out->set_iteration(record.iteration);
  ToProto(record.gains, out->mutable_gains());
  if (HasCost(record.outcome)) {
    out->set_cost(record.cost);
    out->set_fuel_sum(record.fuel_sum);
  }
  out->set_settling_samples(record.settling_samples);
  out->set_outcome(ToProto(record.outcome));
  out->set_cost_std(record.cost_std);
  out->set_pairs_left_out(record.pairs_left_out);
  out->set_pairs_not_settled(record.pairs_not_settled);
  out->set_episodes(record.episodes);
}

void ToProto(const EpisodeReport& report, v1::EpisodeResult* out) {
  out->set_outcome(ToProto(report.outcome));
  out->set_outcome_message(report.outcome_message);
  out->set_end_time_s(report.end_time_s);
  if (HasCost(report.outcome)) out->set_cost(report.cost);
  out->set_settling_samples(report.settling_samples);
  out->set_settling_time_s(OrZero(report.settling_time_s));
  out->set_fuel_sum(OrZero(report.fuel_sum));
  out->set_delta_v_to_settling_m_s(OrZero(report.delta_v_to_settling_m_s));
  if (!std::isnan(report.delta_v_horizon_m_s)) out->set_delta_v_horizon_m_s(report.delta_v_horizon_m_s);
  out->set_peak_acceleration_m_s2(OrZero(report.peak_acceleration_m_s2));
  out->set_initial_lyapunov(OrZero(report.initial_lyapunov));
  out->set_domain_guarantee(report.domain_guaranteed ? v1::DOMAIN_GUARANTEE_GUARANTEED
                                                     : v1::DOMAIN_GUARANTEE_NOT_GUARANTEED);
}

void ToProto(const JobReport& report, v1::JobReport* out) {
  ToProto(report.initial, out->mutable_initial());
  ToProto(report.final, out->mutable_final());
  ToProto(report.best, out->mutable_best());
  SetReduction(report.initial.episode, report.final.episode, out->mutable_final_reduction());
  SetReduction(report.initial.episode, report.best.episode, out->mutable_best_reduction());
  for (const Warning& warning : report.warnings) {
    v1::Warning* w = out->add_warnings();
    w->set_kind(ToProto(warning.kind));
    w->set_message(warning.message);
  }
  out->set_episodes(report.episodes);
}

void ToProto(const JobRecord& record, v1::Job* out) {
  const JobSpec& spec = record.spec;
  out->set_display_name(spec.display_name);
  for (const auto& [key, value] : spec.labels) (*out->mutable_labels())[key] = value;
  if (!spec.scenario.id.empty()) out->set_scenario(absl::StrCat("scenarios/", spec.scenario.id));
  ToProto(spec.scenario, out->mutable_scenario_definition());
  if (spec.initial_conditions.empty()) {
    ToProto(spec.initial_condition, out->mutable_initial_condition());
  } else {
    for (const OrbitState& state : spec.initial_conditions) ToProto(state, out->add_initial_conditions());
    ToProto(spec.objective, out->mutable_objective());
  }
  out->set_warm_start(spec.warm_start);
  if (!spec.campaign_id.empty()) out->set_campaign(absl::StrCat("campaigns/", spec.campaign_id));
  out->set_owner(spec.owner);
  out->set_priority(spec.priority);
  ToProto(spec.scenario.search, out->mutable_hyperparameters());
  if (record.id.empty()) return;
  out->set_name(absl::StrCat("jobs/", record.id));
  out->set_state(ToProto(record.state));
  SetTime(record.create_time_us, out->mutable_create_time());
  if (record.start_time_us != 0) SetTime(record.start_time_us, out->mutable_start_time());
  if (record.end_time_us != 0) SetTime(record.end_time_us, out->mutable_end_time());
  SetTime(record.update_time_us, out->mutable_update_time());
  out->set_completed_iterations(record.completed_iterations());
  if (record.first) ToProto(*record.first, out->mutable_initial_iteration());
  if (record.latest) ToProto(*record.latest, out->mutable_latest_iteration());
  if (record.best) ToProto(*record.best, out->mutable_best_iteration());
  out->set_last_seq(record.last_seq);
  if (record.iterations_removed_us != 0) {
    SetTime(record.iterations_removed_us, out->mutable_iterations_removed_time());
  }
  if (record.report) ToProto(*record.report, out->mutable_report());
  out->set_error_message(record.error_message);
  if (record.provenance) ProvenanceToProto(record, out->mutable_provenance());
  out->set_etag(EtagOf(record));
}

void ToProto(const JobEvent& event, v1::WatchJobResponse* out) {
  out->set_seq(event.seq);
  if (const auto* iteration = std::get_if<IterationRecord>(&event.what)) {
    return ToProto(*iteration, out->mutable_iteration());
  }
  const auto& change = std::get<StateChange>(event.what);
  v1::StateChange* state = out->mutable_state_change();
  state->set_state(ToProto(change.state));
  SetTime(change.time_us, state->mutable_time());
  state->set_message(change.message);
  if (change.report) ToProto(*change.report, state->mutable_report());
}

void ToProto(const EpisodeAnswer& answer, v1::SimulateEpisodeResponse* out) {
  ToProto(answer.report, out->mutable_result());
  for (const EpisodeSample& sample : answer.trajectory) ToProto(sample, answer.prepared, out->add_trajectory());
}

}  // namespace orbitune
