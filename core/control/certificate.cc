#include "core/control/certificate.h"

#include <algorithm>
#include <cmath>

namespace orbitune {
namespace {

// How far directions can be apart: |d - d_r|^2 <= Lambda (w^2 + x5^2 + x6^2), if that budget is at most s^2.
double Directions(double target_h, double k1, double s) {
  const double one_by_one = 4 + 1 / k1;
  const double arc = 1 - s * s / (4 * k1);  // (2 sin(x1 / 2) / x1)^2 is not less
  if (arc <= 0) return one_by_one;
  const auto shrink = [](double h) { return 1 / (1 + h * h); };
  const double half_trace = 0.5 / k1 + 2 * shrink(std::max(target_h - s, 0.0));
  const double least = shrink(target_h + s);
  const double determinant = 4 * least * least / k1;
  const double root = std::sqrt(std::max(half_trace * half_trace - determinant, 0.0));
  return std::min(one_by_one, (half_trace + root) / arc);
}

}  // namespace

bool StaysInDomain(double initial_lyapunov, double target_eccentricity) {
  const double q = 1 - target_eccentricity;
  return initial_lyapunov < q * q / 2;
}

double SettlingLyapunov(double distance, const TargetOrbit& target, double k1) {
  const double q = 1 - target.eccentricity();
  // S / (q (q - S)) = distance, and S^2 Lambda / (q (q - S)) = distance^2; the bound holds for S < q / 2.
  const double by_radius = std::min(distance * q * q / (1 + distance * q), q / 2);
  const double directions = Directions(std::hypot(target.hx, target.hy), k1, by_radius);
  const double by_direction = 2 * distance * q / (distance + std::sqrt(distance * distance + 4 * directions));
  const double s = std::min(by_radius, by_direction) * (1 - 1e-12);  // rounding must not overstate it
  return s * s / 2;
}

}  // namespace orbitune
