#include "core/control/certificate.h"

#include <algorithm>
#include <cmath>

namespace orbitune {

bool StaysInDomain(double initial_lyapunov, double target_eccentricity) {
  const double q = 1 - target_eccentricity;
  return initial_lyapunov < q * q / 2;
}

double SettlingLyapunov(double distance, double target_eccentricity, double k1) {
  const double q = 1 - target_eccentricity;
  const double directions = 4 + 1 / k1;
  // S / (q (q - S)) = distance, and S^2 directions / (q (q - S)) = distance^2.
  const double by_radius = distance * q * q / (1 + distance * q);
  const double by_direction = 2 * distance * q / (distance + std::sqrt(distance * distance + 4 * directions));
  // The bound holds for S < q / 2; rounding must not overstate it.
  const double s = std::min({by_radius, by_direction, q / 2}) * (1 - 1e-12);
  return s * s / 2;
}

}  // namespace orbitune
