// What the Lyapunov function proves about an episode before, or instead of, simulating it.
#pragma once

#include "core/orbit/target.h"

namespace orbitune {

// True if V(0) < (1 - e_r)^2 / 2: the closed loop is certain to stay in the domain x2 > -1, a > 0. False says nothing.
bool StaysInDomain(double initial_lyapunov, double target_eccentricity);

// c*: the largest c such that V(x) <= c implies y(x) <= distance, by the bound B(c) (docs/model.md, "Early exit").
// distance > 0 in units of p_r, the target's e_r < 1, k1 > 0 canonical. As V never increases, an unmodified closed loop
// that has reached V <= c* has settled for good.
double SettlingLyapunov(double distance, const TargetOrbit& target, double k1);

}  // namespace orbitune
