// Where a job's results come from: what makes its history provable (core/library/history_digest.h), and what computed
// it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/base/digest.h"
#include "core/base/version.h"

namespace orbitune {

// The engine that ran a job's iterations from this one on, up to where the next one in the list takes over.
struct EngineStretch {
  int first_iteration = 0;
  Engine engine;
};

struct Provenance {
  std::string scenario_digest;  // ScenarioDigest
  std::string inputs_digest;    // d(0), in hex
  // Iterations whose digests were not computed as they were run but later, from what was stored: those that a job had
  // when a server came that keeps digests.
  int backfilled = 0;
  std::vector<EngineStretch> engines;  // none before the first iteration, and none for those backfilled
  Digest digest{};                     // of the newest iteration, d(0) before the first
};

// What goes on after an iteration, and is stored in the same commit.
struct Continuation {
  std::vector<double> checkpoint;  // the search's before the iteration; may be empty. Takes the place of the one before
  Digest digest{};                 // of the history with the iteration
  std::optional<Engine> engine;    // where it is not that of the iteration before
};

}  // namespace orbitune
