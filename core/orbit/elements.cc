#include "core/orbit/elements.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace orbitune {
namespace {

constexpr double kPi = std::numbers::pi;
// An orbit closer than this to a singular one has no digits left in its undefined angle.
constexpr double kSingular = 1e-14;

void RequireFinite(FieldErrors& errors, std::string_view field, double value) {
  if (!std::isfinite(value)) errors.AddNumber(field, "a finite number", value);
}

void RequireLength(FieldErrors& errors, std::string_view field, double value) {
  if (!(std::isfinite(value) && value > 0)) errors.AddNumber(field, "> 0 and finite", value);
}

}  // namespace

double EquinoctialElements::eccentricity() const { return std::hypot(ex, ey); }

absl::Status Validate(const EquinoctialElements& elements) {
  FieldErrors errors;
  RequireLength(errors, "p", elements.p);
  RequireFinite(errors, "ex", elements.ex);
  RequireFinite(errors, "ey", elements.ey);
  RequireFinite(errors, "hx", elements.hx);
  RequireFinite(errors, "hy", elements.hy);
  RequireFinite(errors, "true_longitude", elements.true_longitude);
  if (elements.eccentricity() >= 1) {
    errors.AddNumber("eccentricity", "< 1, an ellipse (sqrt(ex^2 + ey^2))", elements.eccentricity());
  }
  return errors.ToStatus();
}

absl::Status Validate(const KeplerianElements& elements) {
  FieldErrors errors;
  RequireLength(errors, "semi_major_axis", elements.semi_major_axis);
  if (!(elements.eccentricity >= 0 && elements.eccentricity < 1)) {
    errors.AddNumber("eccentricity", "in [0, 1), an ellipse", elements.eccentricity);
  }
  if (!(elements.inclination >= 0 && elements.inclination <= kPi * (1 - kSingular))) {
    errors.AddNumber("inclination", "in [0, pi) rad: at pi the equinoctial elements are singular",
                     elements.inclination);
  }
  RequireFinite(errors, "raan", elements.raan);
  RequireFinite(errors, "argument_of_periapsis", elements.argument_of_periapsis);
  RequireFinite(errors, "true_anomaly", elements.true_anomaly);
  return errors.ToStatus();
}

absl::StatusOr<EquinoctialElements> ToEquinoctial(const KeplerianElements& k) {
  if (absl::Status status = Validate(k); !status.ok()) return status;
  const double longitude_of_periapsis = k.argument_of_periapsis + k.raan;
  const double tan_half_inclination = std::tan(k.inclination / 2);
  return EquinoctialElements{.true_longitude = longitude_of_periapsis + k.true_anomaly,
                             .p = k.semi_major_axis * (1 - k.eccentricity * k.eccentricity),
                             .ex = k.eccentricity * std::cos(longitude_of_periapsis),
                             .ey = k.eccentricity * std::sin(longitude_of_periapsis),
                             .hx = tan_half_inclination * std::cos(k.raan),
                             .hy = tan_half_inclination * std::sin(k.raan)};
}

absl::StatusOr<EquinoctialElements> ToEquinoctial(const CartesianState& state, double mu) {
  const double r = state.position.norm();
  const double v = state.velocity.norm();
  if (!(std::isfinite(r) && r > 0)) return InvalidField("position", "a finite vector of length > 0", r);
  if (!std::isfinite(v)) return InvalidField("velocity", "a finite vector", v);
  if (!(std::isfinite(mu) && mu > 0)) return InvalidField("mu", "> 0 and finite", mu);
  const Eigen::Vector3d momentum = state.position.cross(state.velocity);
  const double h = momentum.norm();
  if (!(h > kSingular * r * v)) {
    return InvalidField("velocity", "not parallel to the position: a radial trajectory has no orbital plane (|r x v|)",
                        h);
  }
  const Eigen::Vector3d normal = momentum / h;
  if (!(1 + normal.z() > kSingular)) {
    return InvalidField("inclination", "< 180 deg: there the equinoctial elements are singular (cos i)", normal.z());
  }
  EquinoctialElements elements;
  elements.p = h * h / mu;
  elements.hx = -normal.y() / (1 + normal.z());
  elements.hy = normal.x() / (1 + normal.z());
  // The equinoctial frame: f, g in the orbital plane, at longitudes 0 and 90 deg.
  const Eigen::Vector3d f = RadialDirection(0, 1, elements.hx, elements.hy);
  const Eigen::Vector3d g = RadialDirection(1, 0, elements.hx, elements.hy);
  elements.true_longitude = std::atan2(state.position.dot(g), state.position.dot(f));
  const Eigen::Vector3d eccentricity = state.velocity.cross(momentum) / mu - state.position / r;
  elements.ex = eccentricity.dot(f);
  elements.ey = eccentricity.dot(g);
  if (absl::Status status = Validate(elements); !status.ok()) return status;
  return elements;
}

absl::StatusOr<KeplerianElements> ToKeplerian(const EquinoctialElements& m) {
  if (absl::Status status = Validate(m); !status.ok()) return status;
  const double e = m.eccentricity();
  const double h = std::hypot(m.hx, m.hy);
  const double raan = h > 0 ? std::atan2(m.hy, m.hx) : 0;
  const double longitude_of_periapsis = e > 0 ? std::atan2(m.ey, m.ex) : raan;
  return KeplerianElements{.semi_major_axis = m.p / (1 - e * e),
                           .eccentricity = e,
                           .inclination = 2 * std::atan(h),
                           .raan = raan,
                           .argument_of_periapsis = longitude_of_periapsis - raan,
                           .true_anomaly = m.true_longitude - longitude_of_periapsis};
}

Eigen::Vector3d RadialDirection(double sin_longitude, double cos_longitude, double hx, double hy) {
  const double s2 = 1 + hx * hx + hy * hy;
  const double eta = hx * sin_longitude - hy * cos_longitude;
  return {(cos_longitude + (hx * hx - hy * hy) * cos_longitude + 2 * hx * hy * sin_longitude) / s2,
          (sin_longitude - (hx * hx - hy * hy) * sin_longitude + 2 * hx * hy * cos_longitude) / s2, 2 * eta / s2};
}

absl::StatusOr<CartesianState> ToCartesian(const EquinoctialElements& m, double mu) {
  if (absl::Status status = Validate(m); !status.ok()) return status;
  if (!(std::isfinite(mu) && mu > 0)) return InvalidField("mu", "> 0 and finite", mu);
  const double s = std::sin(m.true_longitude);
  const double c = std::cos(m.true_longitude);
  const Eigen::Vector3d f = RadialDirection(0, 1, m.hx, m.hy);
  const Eigen::Vector3d g = RadialDirection(1, 0, m.hx, m.hy);
  const double r = m.p / (1 + m.ex * c + m.ey * s);
  return CartesianState{.position = r * (c * f + s * g),
                        .velocity = std::sqrt(mu / m.p) * (-(s + m.ey) * f + (c + m.ex) * g)};
}

}  // namespace orbitune
