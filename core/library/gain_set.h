// Gain sets: gains that were tuned, averaged or imported, with where they come from and what flying them came to.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "core/library/flight.h"

namespace orbitune {

enum class GainSetKind {
  kTuned,     // the best of a job with one initial condition
  kRobust,    // the best of a job with several
  kMean,      // the mean of a campaign's tuned gains
  kImported,  // from a file; flown here before it was stored
};

// What a gain set is good for and what it came from. Never changes.
struct GainSet {
  std::string id;
  GainSetKind kind = GainSetKind::kTuned;
  std::string display_name;
  std::int64_t create_time_us = 0;  // microseconds since the Unix epoch, UTC

  Gains gains{};
  double velocity_unit_m_s = 0;       // of K1
  double acceleration_unit_m_s2 = 0;  // of K2..K5
  Scenario scenario;            // as LibraryDefinition (scenario_digest.h) leaves it; its id is what it was called
  std::string scenario_digest;  // ScenarioDigest(scenario)

  // Where the gains were flown from, and the error coordinates x(0) there. Gains for several initial conditions
  // (kRobust, kMean) have neither.
  OrbitState initial_condition;
  std::optional<ErrorState> initial_error;

  // Provenance; empty or 0 where there is none.
  std::string job_id;
  std::string campaign_id;
  int iteration = 0;
  std::string algorithm;
  std::uint64_t seed = 0;
  std::string engine_version;
  std::string origin;          // of kImported: its name where it was exported
  std::string history_digest;  // of the job, in hex (history_digest.h)

  // Under these gains: from initial_condition, or over the initial conditions that they are for.
  Flight flight;
};

}  // namespace orbitune
