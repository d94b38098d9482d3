#include "server/convert/gains.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "server/convert/job.h"
#include "server/convert/number.h"

namespace orbitune {
namespace {

v1::GainSetKind ToProto(GainSetKind kind) {
  switch (kind) {
    case GainSetKind::kTuned:
      return v1::GAIN_SET_KIND_TUNED;
    case GainSetKind::kRobust:
      return v1::GAIN_SET_KIND_ROBUST;
    case GainSetKind::kMean:
      return v1::GAIN_SET_KIND_MEAN;
    case GainSetKind::kImported:
      return v1::GAIN_SET_KIND_IMPORTED;
  }
  return v1::GAIN_SET_KIND_UNSPECIFIED;
}

v1::CandidateSource ToProto(Candidate::Source source) {
  switch (source) {
    case Candidate::Source::kStored:
      return v1::CANDIDATE_SOURCE_STORED;
    case Candidate::Source::kWeightedMean:
      return v1::CANDIDATE_SOURCE_WEIGHTED_MEAN;
    case Candidate::Source::kLibraryMean:
      return v1::CANDIDATE_SOURCE_LIBRARY_MEAN;
    case Candidate::Source::kInitial:
      return v1::CANDIDATE_SOURCE_INITIAL;
    case Candidate::Source::kRefined:
      return v1::CANDIDATE_SOURCE_REFINED;
  }
  return v1::CANDIDATE_SOURCE_UNSPECIFIED;
}

void ToProto(const ErrorState& x, v1::ErrorCoordinates* out) {
  out->set_x1(x.x1);
  out->set_x2(x.x2);
  out->set_x3(x.x3);
  out->set_x4(x.x4);
  out->set_x5(x.x5);
  out->set_x6(x.x6);
}

void ToProto(const Flight& flight, v1::Flight* out) {
  out->set_outcome(orbitune::ToProto(flight.outcome));
  out->set_outcome_message(flight.outcome_message);
  if (HasCost(flight.outcome)) out->set_cost(flight.cost);
  out->set_settling_samples(flight.settling_samples);
  out->set_settling_time_s(OrZero(flight.settling_time_s));
  out->set_fuel_sum(OrZero(flight.fuel_sum));
  out->set_delta_v_m_s(OrZero(flight.delta_v_m_s));
  out->set_peak_acceleration_m_s2(OrZero(flight.peak_acceleration_m_s2));
  v1::Certificate& certificate = *out->mutable_certificate();
  certificate.set_gains_positive(flight.certificate.gains_positive);
  certificate.set_domain_guaranteed(flight.certificate.domain_guaranteed);
  certificate.set_lyapunov_decreasing(flight.certificate.lyapunov_decreasing);
  certificate.set_settled(flight.certificate.settled);
}

void ToProto(const QueryAnswer& answer, v1::GainAnswer* out) {
  const Candidate& candidate = answer.candidate;
  out->set_source(ToProto(candidate.source));
  if (candidate.source == Candidate::Source::kStored) {
    out->set_gain_set(absl::StrCat("gainSets/", candidate.gain_set_id));
    out->set_kind(ToProto(candidate.kind));
    if (!std::isnan(candidate.distance)) out->set_distance(candidate.distance);
  }
  orbitune::ToProto(candidate.gains, out->mutable_gains());
  ToProto(answer.flight, out->mutable_flight());
}

void ToProto(const LibraryPosition& position, v1::LibraryPosition* out) {
  out->set_library_size(static_cast<std::int64_t>(position.library_size));
  out->set_located(static_cast<std::int64_t>(position.located));
  if (!std::isnan(position.nearest_distance)) out->set_nearest_distance(position.nearest_distance);
  if (!std::isnan(position.centre_distance)) out->set_centre_distance(position.centre_distance);
  if (!std::isnan(position.typical_distance)) out->set_typical_distance(position.typical_distance);
  out->set_extrapolated(position.extrapolated);
}

// Empty stays empty.
std::string NameIn(std::string_view collection, const std::string& id) {
  return id.empty() ? "" : absl::StrCat(ToAbsl(collection), "/", id);
}

}  // namespace

absl::StatusOr<GainQuery> FromProto(const v1::QueryGainsRequest& request) {
  GainQuery query;
  auto scenario = ChoiceFromProto(request.scenario(), request.has_scenario_definition(), request.scenario_definition());
  if (!scenario.ok()) return scenario.status();
  query.scenario = *std::move(scenario);
  query.initial_condition = FromProto(request.initial_condition());
  query.max_candidates = request.max_candidates();
  query.max_answers = request.max_answers();
  if (request.has_refine()) query.refine_budget_ms = request.refine().budget_ms();
  return query;
}

void ToProto(const GainQueryAnswer& answer, v1::QueryGainsResponse* out) {
  const QueryResult& result = answer.result;
  for (const QueryAnswer& one : result.answers) ToProto(one, out->add_answers());
  out->set_settled(result.settled());
  ToProto(result.position, out->mutable_position());
  out->set_candidates(result.candidates);
  out->set_candidates_settled(result.candidates_settled);
  if (result.refined) {
    out->mutable_refinement()->set_episodes(result.refined->episodes);
    out->mutable_refinement()->set_elapsed_s(result.refined->elapsed_s);
    out->mutable_refinement()->set_improved(result.refined->improved);
  }
  out->set_message(answer.message);
  out->set_scenario_digest(answer.scenario_digest);
  ToProto(answer.prepared.problem.initial_error, out->mutable_initial_error());
  out->set_velocity_unit_m_s(answer.prepared.velocity_unit_m_s);
  out->set_acceleration_unit_m_s2(answer.prepared.acceleration_unit_m_s2);
}

absl::StatusOr<ImportedGainSet> FromProto(const v1::GainSet& set) {
  ImportedGainSet imported;
  auto scenario = ChoiceFromProto(set.scenario(), set.has_scenario_definition(), set.scenario_definition());
  if (!scenario.ok()) return scenario.status();
  imported.scenario = *std::move(scenario);
  imported.scenario_digest = set.scenario_digest();
  if (set.velocity_unit_m_s() != 0) imported.velocity_unit_m_s = set.velocity_unit_m_s();
  if (set.acceleration_unit_m_s2() != 0) imported.acceleration_unit_m_s2 = set.acceleration_unit_m_s2();
  imported.display_name = set.display_name();
  imported.gains = FromProto(set.gains());
  imported.initial_condition = FromProto(set.initial_condition());
  imported.iteration = set.iteration();
  imported.algorithm = set.algorithm();
  imported.seed = set.seed();
  imported.engine_version = set.engine_version();
  imported.history_digest = set.history_digest();
  imported.origin = set.name();
  return imported;
}

void ToProto(const GainSet& set, v1::GainSet* out) {
  out->set_name(NameIn("gainSets", set.id));
  out->set_kind(ToProto(set.kind));
  out->set_display_name(set.display_name);
  if (set.create_time_us != 0) SetTime(set.create_time_us, out->mutable_create_time());
  ToProto(set.gains, out->mutable_gains());
  out->set_velocity_unit_m_s(set.velocity_unit_m_s);
  out->set_acceleration_unit_m_s2(set.acceleration_unit_m_s2);
  out->set_scenario(NameIn("scenarios", set.scenario.id));
  out->set_scenario_digest(set.scenario_digest);
  if (set.initial_error) {
    ToProto(set.initial_condition, out->mutable_initial_condition());
    ToProto(*set.initial_error, out->mutable_initial_error());
  }
  out->set_job(NameIn("jobs", set.job_id));
  out->set_campaign(NameIn("campaigns", set.campaign_id));
  out->set_iteration(set.iteration);
  out->set_algorithm(set.algorithm);
  out->set_seed(set.seed);
  out->set_engine_version(set.engine_version);
  out->set_history_digest(set.history_digest);
  out->set_origin(set.origin);
  ToProto(set.flight, out->mutable_flight());
}

void DefinitionToProto(const GainSet& set, v1::Scenario* out) {
  ToProto(set.scenario, out);
  out->clear_chaser();
  out->clear_hyperparameters();
}

}  // namespace orbitune
