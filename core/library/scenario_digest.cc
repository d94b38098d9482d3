#include "core/library/scenario_digest.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/check.h"
#include "core/base/digest.h"
#include "core/library/orbit_elements.h"

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

std::vector<Field> DigestFields(const Scenario& scenario) {
  Fields fields;
  fields.Add("gravitational_parameter_km3_s2", scenario.gravitational_parameter_km3_s2);
  ForEachElement(scenario.target, [&fields](const char* form, const char* name, double value) {
    fields.Add(absl::StrCat("target.", form, ".", name), value);
  });
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
