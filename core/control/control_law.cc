#include "core/control/control_law.h"

#include <cmath>

namespace orbitune {
namespace {

// The entries of F at one state.
struct DriftTerms {
  double a;  // x3 + 1 + zeta_X^r
  double f12, f13, f33, f42, f43;
};

DriftTerms Drift(const ErrorState& x, const TargetPhase& phase) {
  const double a = InverseRadius(x, phase);
  const double f13 = x.x3 + 2 + 2 * phase.zeta_x;
  return {.a = a,
          .f12 = a * a,
          .f13 = f13,
          .f33 = f13 * phase.zeta_y,
          .f42 = (x.x2 + 2) * a * a * a,
          .f43 = f13 * phase.zeta_x};
}

// The non-zero entries of H.
struct NormalInput {
  double h1, h5, h6;
};

NormalInput NormalInputOf(const ErrorState& x, const TargetOrbit& target, const TargetPhase& phase, double s1,
                          double c1) {
  const double s = s1 * phase.cos_longitude + c1 * phase.sin_longitude;  // sin(x1 + L_r)
  const double c = c1 * phase.cos_longitude - s1 * phase.sin_longitude;
  const double hx = x.x5 + target.hx;
  const double hy = x.x6 + target.hy;
  const double scale = 1 / (InverseRadius(x, phase) * (x.x2 + 1));  // G22 / (x2 + 1)
  const double half = scale * (1 + hx * hx + hy * hy) / 2;
  return {.h1 = scale * (hx * s - hy * c), .h5 = half * c, .h6 = half * s};
}

}  // namespace

double Control::norm() const { return std::sqrt(radial * radial + transverse * transverse + normal * normal); }

LawValue EvaluateLaw(const ErrorState& x, const TargetOrbit& target, const TargetPhase& phase,
                     const CanonicalGains& k) {
  const double s1 = std::sin(x.x1);
  const double c1 = std::cos(x.x1);
  const DriftTerms f = Drift(x, phase);

  // xi and its rate along the planar motion: u_h must not enter it, or V would not be proved to decrease.
  const double damping = k.k3 - f.f33;
  const double xi = (k.k1 * f.f13 * s1 + damping * x.x3) / f.f12;
  const double rate1 = f.f12 * x.x2 + f.f13 * x.x3;
  const double rate3 = -f.f33 * x.x3 - f.f12 * x.x4;
  const double longitude_rate = TargetOrbit::LongitudeRate(phase);
  const double zeta_x_rate = -phase.zeta_y * longitude_rate;
  const double zeta_y_rate = phase.zeta_x * longitude_rate;
  const double f13_rate = rate3 + 2 * zeta_x_rate;
  const double f12_rate = 2 * f.a * (rate3 + zeta_x_rate);
  const double f33_rate = f13_rate * phase.zeta_y + f.f13 * zeta_y_rate;
  const double n_rate = k.k1 * (f13_rate * s1 + f.f13 * c1 * rate1) - f33_rate * x.x3 + damping * rate3;
  const double xi_rate = (n_rate - xi * f12_rate) / f.f12;

  const double z = x.x4 - xi;
  const NormalInput h = NormalInputOf(x, target, phase, s1, c1);
  const double v_h = h.h1 * k.k1 * (s1 - z * f.f13 * c1 / f.f12) + x.x5 * h.h5 + x.x6 * h.h6;  // dV/dx H

  const double half_sine = std::sin(x.x1 / 2);
  LawValue value;
  value.u.radial = -(f.f43 * x.x3 - xi_rate) - k.k4 * z;
  value.u.transverse = -f.a * (k.k1 * f.f12 * s1 + f.f42 * z + k.k2 * x.x2);  // 1 / G22 = a
  value.u.normal = -k.k5 * v_h;
  value.lyapunov =
      2 * k.k1 * half_sine * half_sine + (x.x2 * x.x2 + x.x3 * x.x3 + z * z + x.x5 * x.x5 + x.x6 * x.x6) / 2;
  value.lyapunov_rate = -(k.k2 * x.x2 * x.x2 + k.k3 * x.x3 * x.x3 + k.k4 * z * z) - k.k5 * v_h * v_h;
  return value;
}

ErrorState ErrorRates(const ErrorState& x, const TargetOrbit& target, const TargetPhase& phase, const Control& u) {
  const DriftTerms f = Drift(x, phase);
  const NormalInput h = NormalInputOf(x, target, phase, std::sin(x.x1), std::cos(x.x1));
  return {.x1 = f.f12 * x.x2 + f.f13 * x.x3 + h.h1 * u.normal,
          .x2 = u.transverse / f.a,
          .x3 = -f.f33 * x.x3 - f.f12 * x.x4,
          .x4 = f.f42 * x.x2 + (f.f12 + f.f43) * x.x3 + u.radial,
          .x5 = h.h5 * u.normal,
          .x6 = h.h6 * u.normal};
}

}  // namespace orbitune
