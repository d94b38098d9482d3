// What computes in this process: stored with what it computes.
#pragma once

#include "core/base/version.h"

namespace orbitune {

// With the instruction set in use now (lane_kernel.h).
Engine CurrentEngine();

}  // namespace orbitune
