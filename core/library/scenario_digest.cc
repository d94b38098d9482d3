#include "core/library/scenario_digest.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/check.h"
#include "core/base/digest.h"

namespace orbitune {
namespace {

struct Field {
  std::string name;
  std::string value;

  bool operator==(const Field&) const = default;
};

class Fields {
 public:
  void Add(std::string_view name, double value) {
    // Fewer digits than there are: the last bit of a tangent is another C library's to choose. -0.0 and 0.0 fly alike.
    fields_.push_back({std::string(name), absl::StrFormat("%.14g", value == 0 ? 0 : value)});
  }
  void AddText(std::string_view name, std::string_view value) {
    fields_.push_back({std::string(name), std::string(value)});
  }
  std::vector<Field> Take() && { return std::move(fields_); }

 private:
  std::vector<Field> fields_;
};

void AddOrbit(Fields&, const std::monostate&) {}

void AddOrbit(Fields& fields, const KeplerianState& s) {
  fields.Add("target.keplerian.semi_major_axis_km", s.semi_major_axis_km);
  fields.Add("target.keplerian.eccentricity", s.eccentricity);
  fields.Add("target.keplerian.inclination_deg", s.inclination_deg);
  fields.Add("target.keplerian.raan_deg", s.raan_deg);
  fields.Add("target.keplerian.argument_of_periapsis_deg", s.argument_of_periapsis_deg);
  const bool anomaly = s.position == KeplerianState::Position::kTrueAnomaly;
  fields.Add(anomaly ? "target.keplerian.true_anomaly_deg" : "target.keplerian.true_longitude_deg", s.position_deg);
}

void AddOrbit(Fields& fields, const EquinoctialState& s) {
  fields.Add("target.equinoctial.p_km", s.p_km);
  fields.Add("target.equinoctial.ex", s.ex);
  fields.Add("target.equinoctial.ey", s.ey);
  fields.Add("target.equinoctial.hx", s.hx);
  fields.Add("target.equinoctial.hy", s.hy);
  fields.Add("target.equinoctial.true_longitude_deg", s.true_longitude_deg);
}

void AddOrbit(Fields& fields, const CartesianStateKm& s) {
  fields.Add("target.cartesian.x_km", s.x_km);
  fields.Add("target.cartesian.y_km", s.y_km);
  fields.Add("target.cartesian.z_km", s.z_km);
  fields.Add("target.cartesian.x_dot_km_s", s.x_dot_km_s);
  fields.Add("target.cartesian.y_dot_km_s", s.y_dot_km_s);
  fields.Add("target.cartesian.z_dot_km_s", s.z_dot_km_s);
}

std::vector<Field> DigestFields(const Scenario& scenario) {
  Fields fields;
  fields.Add("gravitational_parameter_km3_s2", scenario.gravitational_parameter_km3_s2);
  std::visit([&](const auto& orbit) { AddOrbit(fields, orbit); }, scenario.target);
  fields.Add("sampling_period_s", scenario.sampling_period_s);
  fields.Add("horizon_samples", scenario.horizon_samples);
  fields.Add("fuel_weight", scenario.fuel_weight);
  fields.Add("settling_distance_km", scenario.settling_distance_km);
  fields.AddText("control_hold", scenario.control_hold == ControlHold::kContinuous ? "CONTINUOUS" : "ZERO_ORDER");
  const auto target = Resolve(scenario.target, scenario.gravitational_parameter_km3_s2);
  ORBITUNE_CHECK(target.ok());
  const CanonicalUnits units = CanonicalUnitsOf(scenario.gravitational_parameter_km3_s2, target->p);
  const auto resolved = [](double given, double otherwise) { return given > 0 ? given : otherwise; };
  fields.Add("velocity_unit_m_s", resolved(scenario.velocity_unit_m_s, units.velocity_m_s()));
  fields.Add("acceleration_unit_m_s2", resolved(scenario.acceleration_unit_m_s2, units.acceleration_m_s2()));
  return std::move(fields).Take();
}

std::string ValueOf(const std::vector<Field>& fields, std::string_view name) {
  for (const Field& field : fields) {
    if (field.name == name) return field.value;
  }
  return "none";
}

}  // namespace

std::string ScenarioDigest(const Scenario& scenario) {
  std::string text = "orbitune scenario 1\n";
  for (const Field& field : DigestFields(scenario)) absl::StrAppend(&text, field.name, "=", field.value, "\n");
  return ToHex(Sha256(text));
}

Scenario LibraryDefinition(const Scenario& scenario) {
  Scenario definition = scenario;
  definition.chaser = std::monostate();
  definition.integration_tolerance = kDefaultIntegrationTolerance;
  definition.search = {};
  definition.neighbourhood = std::monostate();
  return definition;
}

std::vector<std::string> DigestDifferences(const Scenario& there, const Scenario& here) {
  const std::vector<Field> theirs = DigestFields(there);
  const std::vector<Field> ours = DigestFields(here);
  std::vector<std::string> differences;
  const auto note = [&](const std::string& name) {
    const std::string a = ValueOf(theirs, name);
    const std::string b = ValueOf(ours, name);
    if (a != b) differences.push_back(absl::StrCat(name, ": ", a, " there, ", b, " here"));
  };
  for (const Field& field : ours) note(field.name);
  for (const Field& field : theirs) {
    if (ValueOf(ours, field.name) == "none") note(field.name);
  }
  return differences;
}

}  // namespace orbitune
