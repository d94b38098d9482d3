// What the documents of the database are made of: the names of enums and the fields of structs, once for writing and
// reading. For storage/serialise.cc alone.
#pragma once

#include <array>
#include <concepts>
#include <string_view>
#include <type_traits>

#include "storage/campaign.h"
#include "storage/job.h"

namespace orbitune::serialise {

// The names of an enum's values, in their order.
template <typename E>
constexpr std::array<std::string_view, 0> kNames{};
template <>
constexpr std::array<std::string_view, 6> kNames<JobState>{"QUEUED",    "RUNNING", "PAUSED",
                                                           "SUCCEEDED", "FAILED",  "CANCELLED"};
template <>
constexpr std::array<std::string_view, 4> kNames<Outcome>{"SETTLED", "NOT_SETTLED", "LEFT_DOMAIN", "NUMERICAL_FAILURE"};
template <>
constexpr std::array<std::string_view, 2> kNames<ControlHold>{"CONTINUOUS", "ZERO_ORDER"};
template <>
constexpr std::array<std::string_view, 2> kNames<KeplerianState::Position>{"TRUE_ANOMALY", "TRUE_LONGITUDE"};
template <>
constexpr std::array<std::string_view, 3> kNames<Algorithm>{"ARS", "CMA_ES", "NELDER_MEAD"};
template <>
constexpr std::array<std::string_view, 3> kNames<Schedule>{"CONSTANT", "LINEAR", "INVERSE_SQRT"};
template <>
constexpr std::array<std::string_view, 4> kNames<Aggregate>{"MEAN", "PERCENTILE", "CVAR", "WORST"};
template <>
constexpr std::array<std::string_view, 4> kNames<GainSetKind>{"TUNED", "ROBUST", "MEAN", "IMPORTED"};
template <>
constexpr std::array<std::string_view, 6> kNames<WarningKind>{"GAIN_AT_FLOOR", "LAST_NOT_BEST", "PEAK_ACCELERATION",
                                                              "NOT_SETTLED",   "DELTA_V_ROSE",  "PAIRS_LEFT_OUT"};
template <>
constexpr std::array<std::string_view, 6> kNames<CampaignState>{"RUNNING",   "PAUSED", "EVALUATING",
                                                                "SUCCEEDED", "FAILED", "CANCELLED"};
template <>
constexpr std::array<std::string_view, 3> kNames<MemberRole>{"TUNED", "HELD_OUT", "ROBUST"};
template <>
constexpr std::array<std::string_view, 6> kNames<GainsChoice>{"INITIAL", "TUNED", "BEST", "MEAN", "ROBUST", "NEAREST"};

// The fields of each struct, once for writing and reading: visit(name, field).
// visit.Later(name, field): one that version 1 of the documents did not have. It is written only where it differs from
// its default, which therefore never changes; so a job that does not use it has the document it always had.
template <typename T, typename U>
concept Is = std::same_as<std::remove_const_t<T>, U>;

template <Is<KeplerianState> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("semi_major_axis_km", s.semi_major_axis_km);
  visit("eccentricity", s.eccentricity);
  visit("inclination_deg", s.inclination_deg);
  visit("raan_deg", s.raan_deg);
  visit("argument_of_periapsis_deg", s.argument_of_periapsis_deg);
  visit("position", s.position);
  visit("position_deg", s.position_deg);
}

template <Is<EquinoctialState> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("p_km", s.p_km);
  visit("ex", s.ex);
  visit("ey", s.ey);
  visit("hx", s.hx);
  visit("hy", s.hy);
  visit("true_longitude_deg", s.true_longitude_deg);
}

template <Is<CartesianStateKm> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("x_km", s.x_km);
  visit("y_km", s.y_km);
  visit("z_km", s.z_km);
  visit("x_dot_km_s", s.x_dot_km_s);
  visit("y_dot_km_s", s.y_dot_km_s);
  visit("z_dot_km_s", s.z_dot_km_s);
}

template <Is<SearchOptions> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("iterations", s.iterations);
  visit("step_size", s.step_size);
  visit("exploration_scale", s.exploration_scale);
  visit("directions", s.directions);
  visit("initial_gains", s.initial_gains);
  visit("exploration_std", s.exploration_std);
  visit("gain_floor", s.gain_floor);
  visit("seed", s.seed);
  visit.Later("algorithm", s.algorithm);
  visit.Later("max_episodes", s.max_episodes);
  visit.Later("plateau_stop", s.plateau_stop);
  visit.Later("ars_variants", s.ars_variants);
  visit.Later("cma_es", s.cma_es);
  visit.Later("nelder_mead", s.nelder_mead);
}

template <Is<PlateauStop> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("iterations", s.iterations);
  visit("min_improvement", s.min_improvement);
}

template <Is<ArsVariants> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("top_directions", s.top_directions);
  visit("step_schedule", s.step_schedule);
  visit("exploration_schedule", s.exploration_schedule);
  visit("log_gains", s.log_gains);
}

template <Is<CmaEsOptions> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("population", s.population);
  visit("initial_sigma", s.initial_sigma);
  visit("restarts", s.restarts);
  visit("population_growth", s.population_growth);
}

template <Is<NelderMeadOptions> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("initial_step", s.initial_step);
  visit("restarts", s.restarts);
}

template <Is<Objective> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("aggregate", s.aggregate);
  visit("level", s.level);
  visit("relative_to_initial", s.relative_to_initial);
}

template <Is<Scenario> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("id", s.id);
  visit("display_name", s.display_name);
  visit("description", s.description);
  visit("gravitational_parameter_km3_s2", s.gravitational_parameter_km3_s2);
  visit("target", s.target);
  visit("chaser", s.chaser);
  visit("sampling_period_s", s.sampling_period_s);
  visit("horizon_samples", s.horizon_samples);
  visit("fuel_weight", s.fuel_weight);
  visit("settling_distance_km", s.settling_distance_km);
  visit("velocity_unit_m_s", s.velocity_unit_m_s);
  visit("acceleration_unit_m_s2", s.acceleration_unit_m_s2);
  visit("control_hold", s.control_hold);
  visit("integration_tolerance", s.integration_tolerance);
  visit("search", s.search);
}

template <Is<JobSpec> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("display_name", s.display_name);
  visit("labels", s.labels);
  visit("scenario", s.scenario);
  visit("initial_condition", s.initial_condition);
  visit.Later("initial_conditions", s.initial_conditions);
  visit.Later("objective", s.objective);
  visit.Later("warm_start", s.warm_start);
  visit.Later("campaign_id", s.campaign_id);
  visit.Later("owner", s.owner);
  visit.Later("peer", s.peer);
  visit.Later("priority", s.priority);
}

template <Is<EpisodeReport> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("outcome", s.outcome);
  visit("outcome_message", s.outcome_message);
  visit("end_time_s", s.end_time_s);
  visit("cost", s.cost);
  visit("settling_samples", s.settling_samples);
  visit("settling_time_s", s.settling_time_s);
  visit("fuel_sum", s.fuel_sum);
  visit("delta_v_to_settling_m_s", s.delta_v_to_settling_m_s);
  visit("delta_v_horizon_m_s", s.delta_v_horizon_m_s);
  visit("peak_acceleration_m_s2", s.peak_acceleration_m_s2);
  visit("initial_lyapunov", s.initial_lyapunov);
  visit("domain_guaranteed", s.domain_guaranteed);
}

template <Is<Spread> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("mean", s.mean);
  visit("min", s.min);
  visit("max", s.max);
}

template <Is<EnsembleReport> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("initial_conditions", s.initial_conditions);
  visit("settled", s.settled);
  visit("objective", s.objective);
  visit("cost", s.cost);
  visit("cost_reduction_percent", s.cost_reduction_percent);
  visit("settling_time_reduction_percent", s.settling_time_reduction_percent);
  visit("fuel_sum_reduction_percent", s.fuel_sum_reduction_percent);
}

template <Is<GainsAssessment> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("iteration", s.iteration);
  visit("gains", s.gains);
  visit("episode", s.episode);
  visit.Later("ensemble", s.ensemble);
}

template <Is<Warning> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("kind", s.kind);
  visit("message", s.message);
}

template <Is<JobReport> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("initial", s.initial);
  visit("final", s.final);
  visit("best", s.best);
  visit("warnings", s.warnings);
  visit("episodes", s.episodes);
}

template <Is<EngineStretch> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("first_iteration", s.first_iteration);
  visit("version", s.engine.version);
  visit("simd_target", s.engine.simd_target);
  visit("fused_multiply_add", s.engine.fused_multiply_add);
  visit("libraries", s.engine.libraries);
}

template <Is<Provenance> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("scenario_digest", s.scenario_digest);
  visit("inputs_digest", s.inputs_digest);
  visit("backfilled", s.backfilled);
  visit("engines", s.engines);
}

template <Is<Certificate> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("gains_positive", s.gains_positive);
  visit("domain_guaranteed", s.domain_guaranteed);
  visit("lyapunov_decreasing", s.lyapunov_decreasing);
  visit("settled", s.settled);
}

template <Is<Flight> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("outcome", s.outcome);
  visit("outcome_message", s.outcome_message);
  visit("cost", s.cost);
  visit("settling_samples", s.settling_samples);
  visit("settling_time_s", s.settling_time_s);
  visit("fuel_sum", s.fuel_sum);
  visit("delta_v_m_s", s.delta_v_m_s);
  visit("peak_acceleration_m_s2", s.peak_acceleration_m_s2);
  visit("certificate", s.certificate);
}

template <Is<GainSet> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("display_name", s.display_name);
  visit("velocity_unit_m_s", s.velocity_unit_m_s);
  visit("acceleration_unit_m_s2", s.acceleration_unit_m_s2);
  visit("initial_condition", s.initial_condition);
  visit("iteration", s.iteration);
  visit("algorithm", s.algorithm);
  visit("seed", s.seed);
  visit("engine_version", s.engine_version);
  visit("origin", s.origin);
  visit.Later("history_digest", s.history_digest);
  visit("flight", s.flight);
}

template <Is<FixedValue> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("value", s.value);
}

template <Is<UniformVariate> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("low", s.low);
  visit("high", s.high);
}

template <Is<NormalVariate> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("mean", s.mean);
  visit("standard_deviation", s.standard_deviation);
}

template <Is<KeplerianDistribution> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("semi_major_axis_km", s.semi_major_axis_km);
  visit("eccentricity", s.eccentricity);
  visit("inclination_deg", s.inclination_deg);
  visit("raan_deg", s.raan_deg);
  visit("argument_of_periapsis_deg", s.argument_of_periapsis_deg);
  visit("position", s.position);
  visit("position_deg", s.position_deg);
  visit("mirrored_periapsis", s.mirrored_periapsis);
}

template <Is<EquinoctialDistribution> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("p_km", s.p_km);
  visit("ex", s.ex);
  visit("ey", s.ey);
  visit("hx", s.hx);
  visit("hy", s.hy);
  visit("true_longitude_deg", s.true_longitude_deg);
}

template <Is<InitialConditionDraws> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("distribution", s.distribution);
  visit("seed", s.seed);
  visit("count", s.count);
}

template <Is<RobustTuning> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("search", s.search);
  visit("objective", s.objective);
}

template <Is<CampaignSpec> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("display_name", s.display_name);
  visit("labels", s.labels);
  visit("scenario", s.scenario);
  visit("warm_start", s.warm_start);
  visit("draws", s.draws);
  visit("held_out_draws", s.held_out_draws);
  visit("tune_held_out", s.tune_held_out);
  visit("robust", s.robust);
  visit.Later("owner", s.owner);
  visit.Later("peer", s.peer);
  visit.Later("priority", s.priority);
}

template <Is<MemberEpisode> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("choice", s.choice);
  visit("gains", s.gains);
  visit("outcome", s.outcome);
  visit("cost", s.cost);
  visit("settling_samples", s.settling_samples);
  visit("fuel_sum", s.fuel_sum);
  visit("delta_v_to_settling_m_s", s.delta_v_to_settling_m_s);
}

template <Is<ReductionStatistics> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("average", s.average);
  visit("minimum", s.minimum);
  visit("maximum", s.maximum);
  visit("percentiles", s.percentiles);
}

template <Is<GainsComparison> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("choice", s.choice);
  visit("over", s.over);
  visit("flown", s.flown);
  visit("settled", s.settled);
  visit("not_settled", s.not_settled);
  visit("without_cost", s.without_cost);
  visit("compared", s.compared);
  visit("cost_percent", s.cost_percent);
  visit("settling_time_percent", s.settling_time_percent);
  visit("fuel_sum_percent", s.fuel_sum_percent);
  visit("delta_v_percent", s.delta_v_percent);
}

template <Is<CampaignResults> T, typename V>
void VisitFields(T& s, V&& visit) {
  visit("mean_of", s.mean_of);
  visit("mean_gains", s.mean_gains);
  visit("robust_gains", s.robust_gains);
  visit("comparisons", s.comparisons);
  visit("best_on_held_out", s.best_on_held_out);
  visit("conclusion", s.conclusion);
  visit("episodes", s.episodes);
}

// The forms of a variant by their names; std::monostate is null.
template <typename V>
void VisitForms(const IcDistribution*, V&& visit) {
  visit("keplerian", KeplerianDistribution{});
  visit("equinoctial", EquinoctialDistribution{});
}

template <typename V>
void VisitForms(const Variate*, V&& visit) {
  visit("fixed", FixedValue{});
  visit("uniform", UniformVariate{});
  visit("normal", NormalVariate{});
}

template <typename V>
void VisitForms(const OrbitState*, V&& visit) {
  visit("keplerian", KeplerianState{});
  visit("equinoctial", EquinoctialState{});
  visit("cartesian", CartesianStateKm{});
}

}  // namespace orbitune::serialise
