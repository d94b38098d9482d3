// The paper's scenarios (section IV), as docs/model.md pins them down.
#pragma once

#include <span>

#include "core/scenario/scenario.h"

namespace orbitune {

// gto-geo, gto-geo-printed, leo-rendezvous. Lives as long as the program.
std::span<const Scenario> Presets();

// nullptr if there is none of that id.
const Scenario* FindPreset(std::string_view id);

}  // namespace orbitune
