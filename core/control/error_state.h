// The tracking error in the paper's coordinates x (eq. (1)), in the target's canonical units (p_r = 1, mu = 1).
#pragma once

#include "core/orbit/target.h"

namespace orbitune {

// x = 0 is the target itself. x1 = L - L_r (unwrapped); 1 + x2 = ratio of the angular momenta; x3, x4 from the
// eccentricity vectors; x5, x6 = difference of the inclination vectors.
struct ErrorState {
  double x1 = 0;
  double x2 = 0;
  double x3 = 0;
  double x4 = 0;
  double x5 = 0;
  double x6 = 0;
};

// a = x3 + 1 + zeta_X^r: the chaser's radius is p_r / a.
inline double InverseRadius(const ErrorState& x, const TargetPhase& phase) { return x.x3 + 1 + phase.zeta_x; }

// The domain of the coordinates: x2 > -1 and a > 0.
bool InDomain(const ErrorState& x, const TargetPhase& phase);

// chaser: canonical (p in units of p_r). Both valid elements; phase: the target's at the same instant.
ErrorState ErrorBetween(const EquinoctialElements& chaser, const TargetOrbit& target, double target_longitude);

// The inverse; x in the domain.
EquinoctialElements ChaserElements(const ErrorState& x, const TargetOrbit& target, double target_longitude);

// y, the paper's eq. (4): the distance between chaser and target in units of p_r; x in the domain.
double Distance(const ErrorState& x, const TargetOrbit& target, const TargetPhase& phase);

}  // namespace orbitune
