// orbitune.v1 gain sets, queries and their answers <-> the domain's.
#pragma once

#include "orbitune/v1/gains.pb.h"
#include "server/convert/orbit.h"
#include "server/service/gain_use_cases.h"

namespace orbitune {

absl::StatusOr<GainQuery> FromProto(const v1::QueryGainsRequest& request);
void ToProto(const GainQueryAnswer& answer, v1::QueryGainsResponse* out);

// What an import takes of a gain set; the rest is ignored.
absl::StatusOr<ImportedGainSet> FromProto(const v1::GainSet& set);
// Without its definition.
void ToProto(const GainSet& set, v1::GainSet* out);
// Without a chaser and hyperparameters.
void DefinitionToProto(const GainSet& set, v1::Scenario* out);

}  // namespace orbitune
