#include "server/convert/orbit.h"

#include "absl/strings/str_cat.h"

namespace orbitune {
namespace {

template <class... Ts>
struct Overloaded : Ts... {
  using Ts::operator()...;
};

constexpr std::string_view kScenarios = "scenarios/";

// A protobuf enum whose values are the domain's, one further on; its 0 is "not given".
template <typename E, typename P>
void ReadEnum(FieldErrors& errors, std::string_view field, P given, bool (*is_valid)(int), std::optional<E>& out) {
  if (!is_valid(given)) {
    errors.Add(field, "one of the values that this version knows", absl::StrCat(static_cast<int>(given)));
  } else if (given != 0) {
    out = static_cast<E>(static_cast<int>(given) - 1);
  }
}

}  // namespace

Gains FromProto(const v1::Gains& g) { return {g.k1(), g.k2(), g.k3(), g.k4(), g.k5()}; }

void ToProto(const Gains& gains, v1::Gains* out) {
  out->set_k1(gains[0]);
  out->set_k2(gains[1]);
  out->set_k3(gains[2]);
  out->set_k4(gains[3]);
  out->set_k5(gains[4]);
}

OrbitState FromProto(const v1::OrbitState& state) {
  switch (state.form_case()) {
    case v1::OrbitState::kKeplerian: {
      const v1::KeplerianElements& k = state.keplerian();
      const bool longitude = k.position_case() == v1::KeplerianElements::kTrueLongitudeDeg;
      return KeplerianState{
          .semi_major_axis_km = k.semi_major_axis_km(),
          .eccentricity = k.eccentricity(),
          .inclination_deg = k.inclination_deg(),
          .raan_deg = k.raan_deg(),
          .argument_of_periapsis_deg = k.argument_of_periapsis_deg(),
          .position = longitude ? KeplerianState::Position::kTrueLongitude : KeplerianState::Position::kTrueAnomaly,
          .position_deg = longitude ? k.true_longitude_deg() : k.true_anomaly_deg()};
    }
    case v1::OrbitState::kEquinoctial: {
      const v1::EquinoctialElements& m = state.equinoctial();
      return EquinoctialState{.p_km = m.p_km(),
                              .ex = m.ex(),
                              .ey = m.ey(),
                              .hx = m.hx(),
                              .hy = m.hy(),
                              .true_longitude_deg = m.true_longitude_deg()};
    }
    case v1::OrbitState::kCartesian: {
      const v1::CartesianState& c = state.cartesian();
      return CartesianStateKm{.x_km = c.x_km(),
                              .y_km = c.y_km(),
                              .z_km = c.z_km(),
                              .x_dot_km_s = c.x_dot_km_s(),
                              .y_dot_km_s = c.y_dot_km_s(),
                              .z_dot_km_s = c.z_dot_km_s()};
    }
    case v1::OrbitState::FORM_NOT_SET:
      break;
  }
  return std::monostate();
}

void ToProto(const OrbitState& state, v1::OrbitState* out) {
  std::visit(Overloaded{[](const std::monostate&) {},
                        [out](const KeplerianState& s) {
                          v1::KeplerianElements* k = out->mutable_keplerian();
                          k->set_semi_major_axis_km(s.semi_major_axis_km);
                          k->set_eccentricity(s.eccentricity);
                          k->set_inclination_deg(s.inclination_deg);
                          k->set_raan_deg(s.raan_deg);
                          k->set_argument_of_periapsis_deg(s.argument_of_periapsis_deg);
                          if (s.position == KeplerianState::Position::kTrueLongitude) {
                            k->set_true_longitude_deg(s.position_deg);
                          } else {
                            k->set_true_anomaly_deg(s.position_deg);
                          }
                        },
                        [out](const EquinoctialState& s) {
                          v1::EquinoctialElements* m = out->mutable_equinoctial();
                          m->set_p_km(s.p_km);
                          m->set_ex(s.ex);
                          m->set_ey(s.ey);
                          m->set_hx(s.hx);
                          m->set_hy(s.hy);
                          m->set_true_longitude_deg(s.true_longitude_deg);
                        },
                        [out](const CartesianStateKm& s) {
                          v1::CartesianState* c = out->mutable_cartesian();
                          c->set_x_km(s.x_km);
                          c->set_y_km(s.y_km);
                          c->set_z_km(s.z_km);
                          c->set_x_dot_km_s(s.x_dot_km_s);
                          c->set_y_dot_km_s(s.y_dot_km_s);
                          c->set_z_dot_km_s(s.z_dot_km_s);
                        }},
             state);
}

absl::StatusOr<Scenario> FromProto(const v1::Scenario& p) {
  Scenario s;
  s.id = p.name().rfind(kScenarios, 0) == 0 ? p.name().substr(kScenarios.size()) : p.name();
  s.display_name = p.display_name();
  s.description = p.description();
  if (p.gravitational_parameter_km3_s2() != 0) s.gravitational_parameter_km3_s2 = p.gravitational_parameter_km3_s2();
  s.target = FromProto(p.target());
  s.chaser = FromProto(p.chaser());
  s.sampling_period_s = p.sampling_period_s();
  s.horizon_samples = p.horizon_samples();
  s.fuel_weight = p.fuel_weight();
  s.settling_distance_km = p.settling_distance_km();
  s.velocity_unit_m_s = p.velocity_unit_m_s();
  s.acceleration_unit_m_s2 = p.acceleration_unit_m_s2();
  switch (p.control_hold()) {
    case v1::CONTROL_HOLD_UNSPECIFIED:
    case v1::CONTROL_HOLD_CONTINUOUS:
      s.control_hold = ControlHold::kContinuous;
      break;
    case v1::CONTROL_HOLD_ZERO_ORDER:
      s.control_hold = ControlHold::kZeroOrder;
      break;
    default:
      return InvalidField("scenario_definition.control_hold", "CONTINUOUS or ZERO_ORDER", p.control_hold());
  }
  if (p.integration_tolerance() != 0) s.integration_tolerance = p.integration_tolerance();
  const auto search = FromProto(p.hyperparameters());
  if (!search.ok()) {
    FieldErrors errors;
    errors.Merge("scenario_definition.hyperparameters", search.status());
    return errors.ToStatus();
  }
  search->ApplyTo(s.search);
  if (p.has_initial_condition_distribution()) s.neighbourhood = FromProto(p.initial_condition_distribution());
  return s;
}

void ToProto(const Scenario& s, v1::Scenario* out) {
  if (!s.id.empty()) out->set_name(absl::StrCat(ToAbsl(kScenarios), s.id));
  out->set_display_name(s.display_name);
  out->set_description(s.description);
  out->set_gravitational_parameter_km3_s2(s.gravitational_parameter_km3_s2);
  ToProto(s.target, out->mutable_target());
  ToProto(s.chaser, out->mutable_chaser());
  out->set_sampling_period_s(s.sampling_period_s);
  out->set_horizon_samples(s.horizon_samples);
  out->set_fuel_weight(s.fuel_weight);
  out->set_settling_distance_km(s.settling_distance_km);
  out->set_velocity_unit_m_s(s.velocity_unit_m_s);
  out->set_acceleration_unit_m_s2(s.acceleration_unit_m_s2);
  out->set_control_hold(s.control_hold == ControlHold::kContinuous ? v1::CONTROL_HOLD_CONTINUOUS
                                                                   : v1::CONTROL_HOLD_ZERO_ORDER);
  out->set_integration_tolerance(s.integration_tolerance);
  ToProto(s.search, out->mutable_hyperparameters());
  if (!std::holds_alternative<std::monostate>(s.neighbourhood)) {
    ToProto(s.neighbourhood, out->mutable_initial_condition_distribution());
  }
}

absl::StatusOr<SearchOverrides> FromProto(const v1::Hyperparameters& p) {
  SearchOverrides s;
  if (p.has_iterations()) s.iterations = p.iterations();
  if (p.has_step_size()) s.step_size = p.step_size();
  if (p.has_exploration_scale()) s.exploration_scale = p.exploration_scale();
  if (p.has_directions()) s.directions = p.directions();
  if (p.has_initial_gains()) s.initial_gains = FromProto(p.initial_gains());
  if (p.has_exploration_std()) s.exploration_std = FromProto(p.exploration_std());
  if (p.has_gain_floor()) s.gain_floor = p.gain_floor();
  if (p.has_seed()) s.seed = p.seed();
  if (p.has_max_episodes()) s.max_episodes = p.max_episodes();
  if (p.plateau_stop().has_iterations()) s.plateau_iterations = p.plateau_stop().iterations();
  if (p.plateau_stop().has_min_improvement()) s.plateau_min_improvement = p.plateau_stop().min_improvement();
  if (p.cma_es().has_population()) s.population = p.cma_es().population();
  if (p.cma_es().has_initial_sigma()) s.initial_sigma = p.cma_es().initial_sigma();
  if (p.cma_es().has_restarts()) s.cma_es_restarts = p.cma_es().restarts();
  if (p.cma_es().has_population_growth()) s.population_growth = p.cma_es().population_growth();
  if (p.nelder_mead().has_initial_step()) s.initial_step = p.nelder_mead().initial_step();
  if (p.nelder_mead().has_restarts()) s.nelder_mead_restarts = p.nelder_mead().restarts();
  const v1::ArsVariants& ars = p.ars_variants();
  if (ars.has_top_directions()) s.top_directions = ars.top_directions();
  if (ars.has_log_gains()) s.log_gains = ars.log_gains();
  FieldErrors errors;
  ReadEnum(errors, "algorithm", p.algorithm(), v1::Algorithm_IsValid, s.algorithm);
  ReadEnum(errors, "ars_variants.step_schedule", ars.step_schedule(), v1::Schedule_IsValid, s.step_schedule);
  ReadEnum(errors, "ars_variants.exploration_schedule", ars.exploration_schedule(), v1::Schedule_IsValid,
           s.exploration_schedule);
  if (!errors.empty()) return errors.ToStatus();
  return s;
}

void ToProto(const SearchOptions& options, v1::Hyperparameters* out) {
  out->set_iterations(options.iterations);
  out->set_step_size(options.step_size);
  out->set_exploration_scale(options.exploration_scale);
  out->set_directions(options.directions);
  ToProto(options.initial_gains, out->mutable_initial_gains());
  ToProto(options.exploration_std, out->mutable_exploration_std());
  out->set_gain_floor(options.gain_floor);
  out->set_seed(options.seed);
  out->set_algorithm(static_cast<v1::Algorithm>(static_cast<int>(options.algorithm) + 1));
  out->set_max_episodes(options.max_episodes);
  out->mutable_plateau_stop()->set_iterations(options.plateau_stop.iterations);
  out->mutable_plateau_stop()->set_min_improvement(options.plateau_stop.min_improvement);
  v1::ArsVariants* ars = out->mutable_ars_variants();
  ars->set_top_directions(options.ars_variants.top_directions);
  ars->set_step_schedule(static_cast<v1::Schedule>(static_cast<int>(options.ars_variants.step_schedule) + 1));
  ars->set_exploration_schedule(
      static_cast<v1::Schedule>(static_cast<int>(options.ars_variants.exploration_schedule) + 1));
  ars->set_log_gains(options.ars_variants.log_gains);
  v1::CmaEsOptions* cma_es = out->mutable_cma_es();
  cma_es->set_population(options.cma_es.population);
  cma_es->set_initial_sigma(options.cma_es.initial_sigma);
  cma_es->set_restarts(options.cma_es.restarts);
  cma_es->set_population_growth(options.cma_es.population_growth);
  out->mutable_nelder_mead()->set_initial_step(options.nelder_mead.initial_step);
  out->mutable_nelder_mead()->set_restarts(options.nelder_mead.restarts);
}

absl::StatusOr<Objective> FromProto(const v1::Objective& p) {
  Objective objective{.level = p.level(), .relative_to_initial = p.relative_to_initial()};
  FieldErrors errors;
  std::optional<Aggregate> aggregate;
  ReadEnum(errors, "aggregate", p.aggregate(), v1::Aggregate_IsValid, aggregate);
  if (!errors.empty()) return errors.ToStatus();
  objective.aggregate = aggregate.value_or(Aggregate::kMean);
  return objective;
}

void ToProto(const Objective& objective, v1::Objective* out) {
  out->set_aggregate(static_cast<v1::Aggregate>(static_cast<int>(objective.aggregate) + 1));
  out->set_level(objective.level);
  out->set_relative_to_initial(objective.relative_to_initial);
}

absl::StatusOr<std::string> IdFromName(std::string_view collection, std::string_view name, std::string_view field) {
  const std::string prefix = absl::StrCat(ToAbsl(collection), "/");
  if (name.starts_with(prefix) && name.size() > prefix.size()) return std::string(name.substr(prefix.size()));
  FieldErrors errors;
  errors.Add(field, absl::StrCat(prefix, "ID"), FormatReceived(name));
  return errors.ToStatus();
}

}  // namespace orbitune
