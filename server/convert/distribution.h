// orbitune.v1 distributions of initial conditions <-> the domain's.
#pragma once

#include "core/scenario/distribution.h"
#include "orbitune/v1/distribution.pb.h"

namespace orbitune {

IcDistribution FromProto(const v1::IcDistribution& distribution);
void ToProto(const IcDistribution& distribution, v1::IcDistribution* out);

}  // namespace orbitune
