// The digest chain that makes a job's history provable: what its search was given, and then every iteration in turn.
// Anybody can compute it again, with a SHA-256 and nothing else of ours (docs/api.md has it in Python).
//
//   d(0) = SHA-256(InputsText)
//   d(i) = SHA-256(d(i - 1), i, K1, K2, K3, K4, K5, J): 84 bytes, without padding
//     d(i - 1)  32 bytes
//     i         4 bytes, unsigned, little-endian
//     K1 .. K5  8 bytes each, IEEE 754 binary64, little-endian
//     J         likewise; where K(i) has no cost, the quiet NaN 0x7ff8000000000000
#pragma once

#include <span>
#include <string>

#include "core/base/digest.h"
#include "core/scenario/scenario.h"
#include "core/search/objective.h"
#include "core/search/search.h"

namespace orbitune {

// d(i) from d(i - 1), i = record.iteration.
Digest ExtendHistory(const Digest& previous, const IterationRecord& record);

// What a history is a function of, exactly, and no name: the line "orbitune job 1", then a line "path=value" for
// scenario_digest and for every field below scenario_definition (but its names, chaser, hyperparameters and
// distribution), initial_condition (or initial_conditions and objective) and hyperparameters of the Job that the API
// shows, in the order of their bytes, each ended by a line feed. Paths are "hyperparameters.initial_gains.k1",
// "initial_conditions[3].keplerian.raan_deg". A number of the JSON form is written as the 16 hexadecimal digits of its
// IEEE 754 bits, the sign first (-0 as 0); anything else (64-bit integers are texts there) as it stands.
// scenario_digest: ScenarioDigest(scenario). initial_conditions: empty but for robust tuning, which alone has an
// objective.
std::string InputsText(const std::string& scenario_digest, const Scenario& scenario,
                       const OrbitState& initial_condition, std::span<const OrbitState> initial_conditions,
                       const Objective& objective);

}  // namespace orbitune
