// Which gain sets belong together: those of scenarios in which the same gains from the same start cost the same.
#pragma once

#include <string>
#include <vector>

#include "core/scenario/scenario.h"

namespace orbitune {

// SHA-256, in hex, of what a flight and its cost depend on: mu, the target's orbit as it is given, sampling period,
// horizon, fuel weight, settling distance, the gains' units (resolved) and the hold. Not of the chaser, the search's
// options, the integrator's tolerance or any name. Numbers count with 14 significant digits. scenario: valid.
std::string ScenarioDigest(const Scenario& scenario);

// The scenario without what the digest leaves out, but for its names.
Scenario LibraryDefinition(const Scenario& scenario);

// The fields, as the API names them, by which the digests of two scenarios differ, each with its two values: "field:
// THERE there, HERE here".
std::vector<std::string> DigestDifferences(const Scenario& there, const Scenario& here);

}  // namespace orbitune
