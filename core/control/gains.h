// The five gains K of the control law (paper eq. (2)).
#pragma once

#include <array>

#include "core/base/status.h"

namespace orbitune {

inline constexpr int kGainCount = 5;

// K1..K5: K1 a velocity, K2..K5 accelerations, in the units that a scenario declares; [i] is K(i+1).
using Gains = std::array<double, kGainCount>;

// The same in the target's canonical units, as the control law needs them.
struct CanonicalGains {
  double k1 = 0;
  double k2 = 0;
  double k3 = 0;
  double k4 = 0;
  double k5 = 0;
};

// What one unit of a gain, and of the control in the cost, is in the target's canonical units.
struct GainUnits {
  double velocity = 1;
  double acceleration = 1;
};

inline CanonicalGains ToCanonical(const Gains& k, const GainUnits& unit) {
  return {k[0] * unit.velocity, k[1] * unit.acceleration, k[2] * unit.acceleration, k[3] * unit.acceleration,
          k[4] * unit.acceleration};
}

}  // namespace orbitune
