// The Lyapunov tracking controller (paper eqs. (2)-(3)), with the two expressions that the paper omits, and the error
// dynamics it acts on. Everything in the target's canonical units: mu = p_r = G41 = 1.
#pragma once

#include "core/control/error_state.h"
#include "core/control/gains.h"

namespace orbitune {

// Acceleration of the chaser in its radial, transverse, normal frame.
struct Control {
  double radial = 0;
  double transverse = 0;
  double normal = 0;

  double norm() const;
};

struct LawValue {
  Control u;
  double lyapunov = 0;       // V(x), eq. (3)
  double lyapunov_rate = 0;  // dV/dt along the closed loop, from its closed form: never > 0 for positive gains
};

// x in the domain, gains > 0. The value is not finite where x is at the domain's edge.
LawValue EvaluateLaw(const ErrorState& x, const TargetOrbit& target, const TargetPhase& phase,
                     const CanonicalGains& gains);

// dx/dt = F x + G [u_r u_theta] + H u_h (paper's eq. (2) of section II).
ErrorState ErrorRates(const ErrorState& x, const TargetOrbit& target, const TargetPhase& phase, const Control& u);

}  // namespace orbitune
