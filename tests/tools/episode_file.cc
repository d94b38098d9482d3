#include "tests/tools/episode_file.h"

#include <charconv>
#include <cmath>
#include <fstream>
#include <limits>
#include <numbers>
#include <optional>
#include <sstream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "core/sim/scalar_simulator.h"

namespace orbitune {
namespace {

using json = nlohmann::ordered_json;

// One JSON object: its fields by name, with every fault booked under its path.
class ObjectReader {
 public:
  ObjectReader(const json& object, std::string prefix, FieldErrors& errors)
      : object_(object), prefix_(std::move(prefix)), errors_(errors) {
    if (!object.is_object()) errors_.Add(prefix_, "an object", Received(object));
  }

  double Number(const char* field) {
    const json* value = Find(field);
    if (value == nullptr) return 0;
    if (value->is_number()) return value->get<double>();
    errors_.Add(Path(field), "a number", Received(*value));
    return 0;
  }

  int Integer(const char* field) {
    const double value = Number(field);
    if (std::nearbyint(value) == value && std::abs(value) <= std::numeric_limits<int>::max()) {
      return static_cast<int>(value);
    }
    errors_.AddNumber(Path(field), "a whole number of 32 bits", value);
    return 0;
  }

  std::string Text(const char* field) {
    const json* value = Find(field);
    if (value == nullptr) return "";
    if (value->is_string()) return value->get<std::string>();
    errors_.Add(Path(field), "a string", Received(*value));
    return "";
  }

  EquinoctialState Orbit(const char* field) {
    const json* value = Find(field);
    if (value == nullptr) return {};
    ObjectReader orbit(*value, Path(field), errors_);
    return {.p_km = orbit.Number("p_km"),
            .ex = orbit.Number("ex"),
            .ey = orbit.Number("ey"),
            .hx = orbit.Number("hx"),
            .hy = orbit.Number("hy"),
            .true_longitude_deg = orbit.Number("true_longitude_rad") * 180 / std::numbers::pi};
  }

  Gains FiveGains(const char* field) {
    Gains gains{};
    const json* value = Find(field);
    if (value == nullptr) return gains;
    if (!value->is_array() || value->size() != gains.size()) {
      errors_.Add(Path(field), "an array of 5 numbers", Received(*value));
      return gains;
    }
    for (std::size_t i = 0; i < gains.size(); ++i) {
      const json& gain = (*value)[i];
      if (gain.is_number()) gains[i] = gain.get<double>();
      if (!(gain.is_number() && std::isfinite(gains[i]) && gains[i] > 0)) {
        errors_.Add(absl::StrCat(Path(field), "[", i, "]"), "a number > 0 and finite", Received(gain));
      }
    }
    return gains;
  }

 private:
  static std::string Received(const json& value) {
    return FormatReceived(value.dump(-1, ' ', false, json::error_handler_t::replace));
  }
  std::string Path(const char* field) const { return prefix_.empty() ? field : absl::StrCat(prefix_, ".", field); }

  const json* Find(const char* field) {
    if (!object_.is_object()) return nullptr;
    const auto found = object_.find(field);
    if (found != object_.end()) return &*found;
    errors_.Add(Path(field), "given", "nothing");
    return nullptr;
  }

  const json& object_;
  const std::string prefix_;
  FieldErrors& errors_;
};

// The sample number that a key stands for.
std::optional<int> SampleOf(const std::string& key) {
  int sample = 0;
  const auto [end, error] = std::from_chars(key.data(), key.data() + key.size(), sample);
  if (error != std::errc() || end != key.data() + key.size() || sample < 0) return std::nullopt;
  return sample;
}

void CheckExpected(const json& expected, FieldErrors& errors) {
  if (!expected.is_object() && !expected.is_null())
    errors.Add("expected", "an object", FormatReceived(expected.dump()));
  for (const char* field : {"distance_km", "control_norm"}) {
    if (!expected.is_object() || !expected.contains(field)) continue;
    const std::string path = absl::StrCat("expected.", field);
    if (!expected[field].is_object()) {
      errors.Add(path, "an object with sample numbers for keys", FormatReceived(expected[field].dump()));
      continue;
    }
    for (const auto& [key, value] : expected[field].items()) {
      if (!SampleOf(key)) errors.Add(path, "keyed by sample numbers >= 0", FormatReceived(key));
    }
  }
}

// A scenario's field names in the file's words.
absl::Status InTheFilesWords(const absl::Status& status) {
  FieldErrors errors;
  for (const FieldViolation& v : FieldViolationsOf(status)) {
    errors.AddViolation({absl::StrReplaceAll(v.field, {{".equinoctial", ""},
                                                       {"gravitational_parameter_km3_s2", "mu_km3_s2"},
                                                       {"settling_distance_km", "tolerance_km"}}),
                         v.description});
  }
  return errors.ToStatus();
}

absl::StatusOr<EpisodeCase> ParseCase(const json& object) {
  FieldErrors errors;
  ObjectReader reader(object, "", errors);
  EpisodeCase episode{.name = reader.Text("name"), .prepared = {}, .gains = reader.FiveGains("gains"), .expected = {}};
  Scenario scenario;
  scenario.gravitational_parameter_km3_s2 = reader.Number("mu_km3_s2");
  scenario.target = reader.Orbit("target");
  scenario.chaser = reader.Orbit("chaser");
  scenario.acceleration_unit_m_s2 = reader.Number("acceleration_unit_m_s2");
  scenario.velocity_unit_m_s = reader.Number("velocity_unit_m_s");
  scenario.sampling_period_s = reader.Number("sampling_period_s");
  scenario.horizon_samples = reader.Integer("horizon_samples");
  scenario.fuel_weight = reader.Number("fuel_weight");
  scenario.settling_distance_km = reader.Number("tolerance_km");
  if (object.is_object() && object.contains("expected")) episode.expected = object["expected"];
  CheckExpected(episode.expected, errors);
  if (!errors.empty()) return errors.ToStatus();
  auto prepared = Prepare(scenario);
  if (!prepared.ok()) return InTheFilesWords(prepared.status());
  episode.prepared = *std::move(prepared);
  return episode;
}

const char* OutcomeName(Outcome outcome) {
  switch (outcome) {
    case Outcome::kSettled:
      return "settled";
    case Outcome::kNotSettled:
      return "not_settled";
    case Outcome::kLeftDomain:
      return "left_domain";
    case Outcome::kNumericalFailure:
      return "numerical_failure";
  }
  return "";
}

}  // namespace

absl::StatusOr<std::vector<EpisodeCase>> ParseEpisodeFile(std::string_view text) {
  json file;
  try {
    file = json::parse(text);
  } catch (const json::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat("not JSON: ", error.what()));
  }
  if (!file.is_array()) return absl::InvalidArgumentError("must be an array of cases");
  std::vector<EpisodeCase> episodes;
  for (const json& object : file) {
    auto episode = ParseCase(object);
    if (!episode.ok()) {
      const bool named = object.is_object() && object.contains("name") && object["name"].is_string();
      return absl::InvalidArgumentError(
          absl::StrCat("case ", episodes.size() + 1,
                       named ? absl::StrCat(" (", FormatReceived(object["name"].get<std::string>()), ")") : "", ": ",
                       episode.status().message()));
    }
    episodes.push_back(*std::move(episode));
  }
  return episodes;
}

absl::StatusOr<std::vector<EpisodeCase>> ReadEpisodeFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  // An empty file sets failbit; ParseEpisodeFile says it better.
  if (!file || !(text << file.rdbuf() || file.eof() || file.peek() == std::ifstream::traits_type::eof())) {
    return absl::NotFoundError("cannot be read");
  }
  return ParseEpisodeFile(text.str());
}

nlohmann::ordered_json RunEpisode(const EpisodeCase& episode) {
  const PreparedScenario& prepared = episode.prepared;
  std::vector<EpisodeSample> trajectory;
  const EpisodeResult result = SimulateEpisode(
      prepared.problem, episode.gains, {.early_exit = false, .measure_effort = true, .trajectory = &trajectory});
  json output;
  output["name"] = episode.name;
  output["outcome"] = OutcomeName(result.outcome);
  output["settling_samples"] = nullptr;
  if (HasCost(result.outcome)) output["settling_samples"] = result.settling_samples;
  // A NaN is written as null.
  output["fuel_sum"] = result.fuel_sum;
  output["cost"] = result.cost;
  output["delta_v_to_settling_m_s"] = result.delta_v_to_settling * prepared.units.velocity_m_s();
  const auto at_samples = [&](const char* field, auto&& value_of) {
    auto& values = output[field] = json::object();
    if (!episode.expected.contains(field)) return;
    for (const auto& [key, unused] : episode.expected[field].items()) {
      const auto sample = static_cast<std::size_t>(SampleOf(key).value());
      values[key] = sample < trajectory.size() ? value_of(trajectory[sample]) : kUnset;
    }
  };
  at_samples("distance_km", [&](const EpisodeSample& s) { return s.distance * prepared.units.length_km; });
  at_samples("control_norm",
             [&](const EpisodeSample& s) { return s.control.norm() / prepared.problem.gain_units.acceleration; });
  return output;
}

}  // namespace orbitune
