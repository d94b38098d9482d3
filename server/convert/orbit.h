// orbitune.v1 orbits, gains and scenarios <-> the domain's. Both ways keep every number exactly as it was given.
#pragma once

#include "orbitune/v1/scenario.pb.h"
#include "orbitune/v1/tuning.pb.h"
#include "server/convert/distribution.h"
#include "server/service/use_cases.h"

namespace orbitune {

Gains FromProto(const v1::Gains& gains);
void ToProto(const Gains& gains, v1::Gains* out);

OrbitState FromProto(const v1::OrbitState& state);
void ToProto(const OrbitState& state, v1::OrbitState* out);

// INVALID_ARGUMENT for an enum value that this version does not know.
absl::StatusOr<Scenario> FromProto(const v1::Scenario& scenario);
void ToProto(const Scenario& scenario, v1::Scenario* out);

// INVALID_ARGUMENT for an enum value that this version does not know.
absl::StatusOr<SearchOverrides> FromProto(const v1::Hyperparameters& hyperparameters);
void ToProto(const SearchOptions& options, v1::Hyperparameters* out);

// INVALID_ARGUMENT for an enum value that this version does not know.
absl::StatusOr<Objective> FromProto(const v1::Objective& objective);
void ToProto(const Objective& objective, v1::Objective* out);

// "scenarios/gto-geo" to "gto-geo"; anything else INVALID_ARGUMENT for `field`.
absl::StatusOr<std::string> IdFromName(std::string_view collection, std::string_view name, std::string_view field);

}  // namespace orbitune
