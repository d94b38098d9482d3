#include "core/library/history_digest.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/library/orbit_elements.h"

namespace orbitune {
namespace {

constexpr std::uint64_t kNoCost = 0x7ff8000000000000;

// As the API names them.
constexpr std::array kHolds{"CONTROL_HOLD_CONTINUOUS", "CONTROL_HOLD_ZERO_ORDER"};
constexpr std::array kAlgorithms{"ALGORITHM_ARS", "ALGORITHM_CMA_ES", "ALGORITHM_NELDER_MEAD"};
constexpr std::array kSchedules{"SCHEDULE_CONSTANT", "SCHEDULE_LINEAR", "SCHEDULE_INVERSE_SQRT"};
constexpr std::array kAggregates{"AGGREGATE_MEAN", "AGGREGATE_PERCENTILE", "AGGREGATE_CVAR", "AGGREGATE_WORST"};

template <typename T>
char* PutLittleEndian(char* at, T value) {
  static_assert(std::endian::native == std::endian::little);
  std::memcpy(at, &value, sizeof value);
  return at + sizeof value;
}

// The lines below a path.
class Lines {
 public:
  Lines(std::vector<std::string>& lines, std::string path) : lines_(lines), path_(std::move(path)) {}

  Lines In(const char* name) const { return {lines_, absl::StrCat(path_, name, ".")}; }

  void Add(const char* name, double value) const {
    const auto bits = std::bit_cast<std::uint64_t>(value == 0 ? 0 : value);
    AddText(name, absl::StrFormat("%016x", bits));
  }
  void AddText(const char* name, const std::string& value) const {
    lines_.push_back(absl::StrCat(path_, name, "=", value, "\n"));
  }
  void AddFlag(const char* name, bool value) const { AddText(name, value ? "true" : "false"); }

  template <typename Enum, std::size_t n>
  void AddName(const char* name, Enum value, const std::array<const char*, n>& names) const {
    AddText(name, names[static_cast<std::size_t>(value)]);
  }

  void AddGains(const char* name, const Gains& gains) const {
    for (std::size_t i = 0; i < gains.size(); ++i) In(name).Add(absl::StrCat("k", i + 1).c_str(), gains[i]);
  }

  void AddOrbit(const OrbitState& state) const {
    ForEachElement(state, [this](const char* form, const char* name, double value) { In(form).Add(name, value); });
  }

 private:
  std::vector<std::string>& lines_;
  const std::string path_;
};

void AddScenario(const Lines& lines, const Scenario& scenario) {
  lines.Add("gravitational_parameter_km3_s2", scenario.gravitational_parameter_km3_s2);
  lines.In("target").AddOrbit(scenario.target);
  lines.Add("sampling_period_s", scenario.sampling_period_s);
  lines.Add("horizon_samples", scenario.horizon_samples);
  lines.Add("fuel_weight", scenario.fuel_weight);
  lines.Add("settling_distance_km", scenario.settling_distance_km);
  lines.Add("velocity_unit_m_s", scenario.velocity_unit_m_s);
  lines.Add("acceleration_unit_m_s2", scenario.acceleration_unit_m_s2);
  lines.AddName("control_hold", scenario.control_hold, kHolds);
  lines.Add("integration_tolerance", scenario.integration_tolerance);
}

void AddSearch(const Lines& lines, const SearchOptions& search) {
  lines.Add("iterations", search.iterations);
  lines.Add("step_size", search.step_size);
  lines.Add("exploration_scale", search.exploration_scale);
  lines.Add("directions", search.directions);
  lines.AddGains("initial_gains", search.initial_gains);
  lines.AddGains("exploration_std", search.exploration_std);
  lines.Add("gain_floor", search.gain_floor);
  lines.AddText("seed", absl::StrCat(search.seed));
  lines.AddName("algorithm", search.algorithm, kAlgorithms);
  lines.AddText("max_episodes", absl::StrCat(search.max_episodes));
  const Lines plateau = lines.In("plateau_stop");
  plateau.Add("iterations", search.plateau_stop.iterations);
  plateau.Add("min_improvement", search.plateau_stop.min_improvement);
  const Lines ars = lines.In("ars_variants");
  ars.Add("top_directions", search.ars_variants.top_directions);
  ars.AddName("step_schedule", search.ars_variants.step_schedule, kSchedules);
  ars.AddName("exploration_schedule", search.ars_variants.exploration_schedule, kSchedules);
  ars.AddFlag("log_gains", search.ars_variants.log_gains);
  const Lines cma_es = lines.In("cma_es");
  cma_es.Add("population", search.cma_es.population);
  cma_es.Add("initial_sigma", search.cma_es.initial_sigma);
  cma_es.Add("restarts", search.cma_es.restarts);
  cma_es.Add("population_growth", search.cma_es.population_growth);
  const Lines nelder_mead = lines.In("nelder_mead");
  nelder_mead.Add("initial_step", search.nelder_mead.initial_step);
  nelder_mead.Add("restarts", search.nelder_mead.restarts);
}

void AddObjective(const Lines& lines, const Objective& objective) {
  lines.AddName("aggregate", objective.aggregate, kAggregates);
  lines.Add("level", objective.level);
  lines.AddFlag("relative_to_initial", objective.relative_to_initial);
}

}  // namespace

Digest ExtendHistory(const Digest& previous, const IterationRecord& record) {
  std::array<char, 32 + 4 + 8 * (kGainCount + 1)> bytes;
  char* at = std::ranges::copy(previous, bytes.data()).out;
  at = PutLittleEndian(at, static_cast<std::uint32_t>(record.iteration));
  for (const double gain : record.gains) at = PutLittleEndian(at, gain);
  PutLittleEndian(at, std::isnan(record.cost) ? kNoCost : std::bit_cast<std::uint64_t>(record.cost));
  return Sha256({bytes.data(), bytes.size()});
}

std::string InputsText(const std::string& scenario_digest, const Scenario& scenario,
                       const OrbitState& initial_condition, std::span<const OrbitState> initial_conditions,
                       const Objective& objective) {
  std::vector<std::string> lines;
  const Lines all(lines, "");
  all.AddText("scenario_digest", scenario_digest);
  AddScenario(all.In("scenario_definition"), scenario);
  AddSearch(all.In("hyperparameters"), scenario.search);
  if (initial_conditions.empty()) {
    all.In("initial_condition").AddOrbit(initial_condition);
  } else {
    AddObjective(all.In("objective"), objective);
  }
  for (std::size_t i = 0; i < initial_conditions.size(); ++i) {
    all.In(absl::StrCat("initial_conditions[", i, "]").c_str()).AddOrbit(initial_conditions[i]);
  }
  std::ranges::sort(lines);
  std::string text = "orbitune job 1\n";
  for (const std::string& line : lines) text += line;
  return text;
}

}  // namespace orbitune
