// The target's orbit and its canonical units: length p_r, time sqrt(p_r^3/mu), so that mu = 1 and p_r = 1.
#pragma once

#include "core/orbit/elements.h"

namespace orbitune {

// One canonical unit of each quantity.
struct CanonicalUnits {
  double length_km = 0;
  double time_s = 0;

  double velocity_m_s() const { return 1e3 * length_km / time_s; }
  double acceleration_m_s2() const { return 1e3 * length_km / (time_s * time_s); }
};

// mu > 0 and p > 0, both finite (checked by the caller).
CanonicalUnits CanonicalUnitsOf(double mu_km3_s2, double p_km);

// The target where it is at one instant: the only time-varying input of the paper's F, G and H.
struct TargetPhase {
  double sin_longitude = 0;  // of L_r
  double cos_longitude = 1;
  double zeta_x = 0;  // zeta_X^r = e cos(nu), as seen from the target's longitude
  double zeta_y = 0;  // zeta_Y^r
};

// An unforced elliptic orbit in its own canonical units; only the true longitude moves.
struct TargetOrbit {
  double ex = 0;
  double ey = 0;
  double hx = 0;
  double hy = 0;
  double initial_longitude = 0;  // L_r(0), rad

  double eccentricity() const;
  // sin, cos: of L_r.
  TargetPhase PhaseAt(double sin_longitude, double cos_longitude) const;
  TargetPhase PhaseAt(double longitude) const;
  // dL_r/dt = (1 + zeta_X^r)^2.
  static double LongitudeRate(const TargetPhase& phase);
};

}  // namespace orbitune
