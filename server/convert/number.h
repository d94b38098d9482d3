// Numbers that there may not be.
#pragma once

#include <cmath>

namespace orbitune {

// 0 for NaN: a value that an episode does not have is left at its default, for the outcome tells.
inline double OrZero(double value) { return std::isnan(value) ? 0 : value; }

}  // namespace orbitune
