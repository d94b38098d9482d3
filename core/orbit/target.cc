#include "core/orbit/target.h"

#include <cmath>

namespace orbitune {

CanonicalUnits CanonicalUnitsOf(double mu_km3_s2, double p_km) {
  return {.length_km = p_km, .time_s = std::sqrt(p_km * p_km * p_km / mu_km3_s2)};
}

double TargetOrbit::eccentricity() const { return std::hypot(ex, ey); }

TargetPhase TargetOrbit::PhaseAt(double s, double c) const {
  // [zeta_X, zeta_Y] = R(L_r) [ex, -ey], below the paper's eq. (1).
  return {.sin_longitude = s, .cos_longitude = c, .zeta_x = ex * c + ey * s, .zeta_y = ex * s - ey * c};
}

TargetPhase TargetOrbit::PhaseAt(double longitude) const { return PhaseAt(std::sin(longitude), std::cos(longitude)); }

double TargetOrbit::LongitudeRate(const TargetPhase& phase) { return (1 + phase.zeta_x) * (1 + phase.zeta_x); }

}  // namespace orbitune
