#include "core/control/error_state.h"

#include <cmath>

namespace orbitune {

bool InDomain(const ErrorState& x, const TargetPhase& phase) {
  return x.x2 > -1 && InverseRadius(x, phase) > 0;  // false for NaN
}

ErrorState ErrorBetween(const EquinoctialElements& chaser, const TargetOrbit& target, double target_longitude) {
  const TargetPhase reference = target.PhaseAt(target_longitude);
  const TargetOrbit chaser_orbit{.ex = chaser.ex, .ey = chaser.ey};
  const TargetPhase own = chaser_orbit.PhaseAt(chaser.true_longitude);
  // (1 + zeta_X) / p - 1 is zeta_X / p - (p - 1) / p, without the cancellation.
  return {.x1 = chaser.true_longitude - target_longitude,
          .x2 = (chaser.p - 1) / (std::sqrt(chaser.p) + 1),
          .x3 = (own.zeta_x - (chaser.p - 1)) / chaser.p - reference.zeta_x,
          .x4 = own.zeta_y / std::sqrt(chaser.p) - reference.zeta_y,
          .x5 = chaser.hx - target.hx,
          .x6 = chaser.hy - target.hy};
}

EquinoctialElements ChaserElements(const ErrorState& x, const TargetOrbit& target, double target_longitude) {
  const TargetPhase phase = target.PhaseAt(target_longitude);
  const double root_p = 1 + x.x2;
  const double p = root_p * root_p;
  const double zeta_x = p * (x.x3 + phase.zeta_x) + x.x2 * (2 + x.x2);
  const double zeta_y = root_p * (x.x4 + phase.zeta_y);
  const double longitude = target_longitude + x.x1;
  const double s = std::sin(longitude);
  const double c = std::cos(longitude);
  return {.true_longitude = longitude,
          .p = p,
          .ex = c * zeta_x + s * zeta_y,
          .ey = s * zeta_x - c * zeta_y,
          .hx = target.hx + x.x5,
          .hy = target.hy + x.x6};
}

double Distance(const ErrorState& x, const TargetOrbit& target, const TargetPhase& phase) {
  const double s1 = std::sin(x.x1);
  const double c1 = std::cos(x.x1);
  const double s = s1 * phase.cos_longitude + c1 * phase.sin_longitude;
  const double c = c1 * phase.cos_longitude - s1 * phase.sin_longitude;
  const Eigen::Vector3d chaser = RadialDirection(s, c, target.hx + x.x5, target.hy + x.x6) / InverseRadius(x, phase);
  const Eigen::Vector3d reference =
      RadialDirection(phase.sin_longitude, phase.cos_longitude, target.hx, target.hy) / (1 + phase.zeta_x);
  return (chaser - reference).norm();
}

}  // namespace orbitune
