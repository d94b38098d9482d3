// A file of episodes, each a case with its orbits, units, gains and cost, and some with the values expected: the form
// of tests/reference/episodes.json. Shared by the tool that runs such a file and by the tests.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "core/scenario/scenario.h"

namespace orbitune {

struct EpisodeCase {
  std::string name;
  PreparedScenario prepared;
  Gains gains{};
  nlohmann::ordered_json expected;  // an object, or null where the case has none
};

// INVALID_ARGUMENT that names the case and every field at fault. Fields of other names are left alone.
absl::StatusOr<std::vector<EpisodeCase>> ParseEpisodeFile(std::string_view text);

absl::StatusOr<std::vector<EpisodeCase>> ReadEpisodeFile(const std::string& path);

// Simulates a case over its whole horizon. distance_km and control_norm (in the case's acceleration unit) at the sample
// numbers that `expected` lists; null for what an outcome or a horizon leaves undefined.
nlohmann::ordered_json RunEpisode(const EpisodeCase& episode);

}  // namespace orbitune
