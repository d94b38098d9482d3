#include "core/control/certificate.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace orbitune {

bool StaysInDomain(double initial_lyapunov, double target_eccentricity) {
  const double q = 1 - target_eccentricity;
  return initial_lyapunov < q * q / 2;
}

double SettlingLyapunov(double distance, double target_eccentricity, double k1) {
  // With s = sqrt(c): B = sqrt2 s / (q (q - sqrt2 s)) + A s / q, A = sqrt(2 / k1) + 2 sqrt2; B = distance is the
  // quadratic  sqrt2 A s^2 - (sqrt2 + q A + sqrt2 distance q) s + distance q^2 = 0, whose smaller root is wanted.
  constexpr double kRoot2 = std::numbers::sqrt2;
  const double q = 1 - target_eccentricity;
  const double a = std::sqrt(2 / k1) + 2 * kRoot2;
  const double b = kRoot2 + q * a + kRoot2 * distance * q;
  const double root = std::sqrt(b * b - 4 * kRoot2 * a * distance * q * q);
  const double s = 2 * distance * q * q / (b + root);
  const double largest = q / 2 / kRoot2;                    // the bound holds for sqrt2 s < q / 2
  const double below = std::min(s, largest) * (1 - 1e-12);  // rounding must not overstate it
  return below * below;
}

}  // namespace orbitune
