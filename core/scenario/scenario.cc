#include "core/scenario/scenario.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace orbitune {
namespace {

bool Positive(double value) { return std::isfinite(value) && value > 0; }

void CheckPositive(FieldErrors& errors, std::string_view field, double value) {
  if (!Positive(value)) errors.AddNumber(field, "> 0 and finite", value);
}

void CheckNotNegative(FieldErrors& errors, std::string_view field, double value, std::string_view zero_means) {
  if (!(std::isfinite(value) && value >= 0)) {
    errors.AddNumber(field, absl::StrCat("> 0 and finite, or 0 for ", ToAbsl(zero_means)), value);
  }
}

// In canonical time, radians of the target's mean motion: beyond, a phase has no digits left that mean anything.
constexpr double kLongestHorizon = 1e5;
// Far beyond any mission, and short of where products of the error coordinates overflow.
constexpr double kLargestSizeRatio = 1e6;

absl::Status CheckRepresentable(const EquinoctialElements& chaser, const EquinoctialElements& target,
                                std::string_view field) {
  FieldErrors errors;
  const auto check = [&](std::string_view what, double value, double low, double high) {
    if (value >= low && value <= high) return;
    errors.Add(field, absl::StrCat("such that its ", ToAbsl(what), " is in [", low, ", ", high, "]"),
               FormatNumber(value));
  };
  check("semi-parameter over the target's", chaser.p / target.p, 1 / kLargestSizeRatio, kLargestSizeRatio);
  check("tan(i/2)", std::hypot(chaser.hx, chaser.hy), 0, kLargestSizeRatio);
  check("target's tan(i/2)", std::hypot(target.hx, target.hy), 0, kLargestSizeRatio);
  return errors.ToStatus();
}

double OrDefault(double value, double default_value) { return value > 0 ? value : default_value; }

}  // namespace

absl::Status Scenario::Validate() const {
  FieldErrors errors;
  CheckPositive(errors, "gravitational_parameter_km3_s2", gravitational_parameter_km3_s2);
  const double mu = Positive(gravitational_parameter_km3_s2) ? gravitational_parameter_km3_s2 : kEarthMuKm3S2;
  errors.Merge("target", Resolve(target, mu).status());
  errors.Merge("chaser", Resolve(chaser, mu).status());
  CheckPositive(errors, "sampling_period_s", sampling_period_s);
  if (horizon_samples < 1 || horizon_samples > kMaxHorizonSamples) {
    errors.AddNumber("horizon_samples", absl::StrCat("in [1, ", kMaxHorizonSamples, "]"), horizon_samples);
  }
  if (!(fuel_weight >= 0 && fuel_weight <= kMaxFuelWeight)) {
    errors.AddNumber("fuel_weight", absl::StrCat("in [0, ", kMaxFuelWeight, "]"), fuel_weight);
  }
  CheckPositive(errors, "settling_distance_km", settling_distance_km);
  CheckNotNegative(errors, "velocity_unit_m_s", velocity_unit_m_s, "sqrt(mu / p_target)");
  CheckNotNegative(errors, "acceleration_unit_m_s2", acceleration_unit_m_s2, "mu / p_target^2");
  if (!(integration_tolerance >= 1e-13 && integration_tolerance <= 1e-5)) {
    errors.AddNumber("integration_tolerance", "in [1e-13, 1e-5]", integration_tolerance);
  }
  if (!std::holds_alternative<std::monostate>(neighbourhood)) {
    errors.Merge("initial_condition_distribution", orbitune::Validate(neighbourhood));
  }
  return errors.ToStatus();
}

absl::StatusOr<PreparedScenario> Prepare(const Scenario& scenario, const OrbitState& initial_condition) {
  if (absl::Status status = scenario.Validate(); !status.ok()) return status;
  const double mu = scenario.gravitational_parameter_km3_s2;
  const bool own = std::holds_alternative<std::monostate>(initial_condition);
  auto chaser = Resolve(own ? scenario.chaser : initial_condition, mu);
  if (!chaser.ok()) {
    FieldErrors errors;
    errors.Merge("initial_condition", chaser.status());
    return errors.ToStatus();
  }
  const EquinoctialElements target = *Resolve(scenario.target, mu);
  if (absl::Status status = CheckRepresentable(*chaser, target, own ? "chaser" : "initial_condition"); !status.ok()) {
    return status;
  }

  PreparedScenario prepared;
  const CanonicalUnits& units = prepared.units = CanonicalUnitsOf(mu, target.p);
  prepared.velocity_unit_m_s = OrDefault(scenario.velocity_unit_m_s, units.velocity_m_s());
  prepared.acceleration_unit_m_s2 = OrDefault(scenario.acceleration_unit_m_s2, units.acceleration_m_s2());

  EpisodeProblem& problem = prepared.problem;
  problem.target = {
      .ex = target.ex, .ey = target.ey, .hx = target.hx, .hy = target.hy, .initial_longitude = target.true_longitude};
  chaser->p /= target.p;
  problem.initial_error = ErrorBetween(*chaser, problem.target, target.true_longitude);
  problem.gain_units = {.velocity = prepared.velocity_unit_m_s / units.velocity_m_s(),
                        .acceleration = prepared.acceleration_unit_m_s2 / units.acceleration_m_s2()};
  problem.sampling_period = scenario.sampling_period_s / units.time_s;
  problem.horizon_samples = scenario.horizon_samples;
  if (!(problem.sampling_period * problem.horizon_samples <= kLongestHorizon)) {
    return InvalidField("sampling_period_s",
                        absl::StrCat("such that the horizon is at most ", kLongestHorizon,
                                     " target radians of mean motion, about ", kLongestHorizon / 6, " orbits"),
                        scenario.sampling_period_s);
  }
  problem.fuel_weight = scenario.fuel_weight;
  problem.settling_distance = scenario.settling_distance_km / target.p;
  problem.hold = scenario.control_hold;
  problem.tolerance = scenario.integration_tolerance;
  return prepared;
}

std::string DescribeOutcome(const EpisodeResult& result, const PreparedScenario& prepared) {
  const double time_s = result.end_time * prepared.units.time_s;
  switch (result.outcome) {
    case Outcome::kSettled:
      return "";
    case Outcome::kNotSettled:
      return absl::StrFormat("not settled within the horizon of %d samples (%g s)", prepared.problem.horizon_samples,
                             time_s);
    case Outcome::kLeftDomain:
      return absl::StrFormat(
          "left the domain of the error coordinates at t = %.6g s: %s (angular momentum at %.3g of the target's, "
          "radius at %.6g km)",
          time_s,
          result.momentum_ratio < result.inverse_radius ? "the angular momentum reached zero"
                                                        : "the radius grew without bound",
          result.momentum_ratio, prepared.units.length_km / result.inverse_radius);
    case Outcome::kNumericalFailure:
      return absl::StrFormat(
          "the integration failed at t = %.6g s: no step size meets the tolerance, or too many steps are needed "
          "(gains too large, or a tolerance too small)",
          time_s);
  }
  return "";
}

}  // namespace orbitune
