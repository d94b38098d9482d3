// Orbital elements and the conversions between their forms. Any consistent units (length l, time t, mu in l^3/t^2);
// angles in radians; one inertial frame throughout.
#pragma once

#include <Eigen/Core>

#include "core/base/status.h"

namespace orbitune {

// Classical elements; 0 <= eccentricity < 1, 0 <= inclination < pi.
struct KeplerianElements {
  double semi_major_axis = 0;
  double eccentricity = 0;
  double inclination = 0;
  double raan = 0;                   // right ascension of the ascending node, Omega
  double argument_of_periapsis = 0;  // omega
  double true_anomaly = 0;           // nu
};

// Modified equinoctial elements (Walker, Ireland, Owens 1985) in the paper's names, section II.
struct EquinoctialElements {
  double true_longitude = 0;  // L = omega + Omega + nu, unwrapped
  double p = 0;               // semi-parameter
  double ex = 0;              // e cos(omega + Omega)
  double ey = 0;              // e sin(omega + Omega)
  double hx = 0;              // tan(i/2) cos(Omega)
  double hy = 0;              // tan(i/2) sin(Omega)

  double eccentricity() const;
};

struct CartesianState {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
};

// INVALID_ARGUMENT naming the field, if a value is not finite, p <= 0 or e >= 1.
absl::Status Validate(const EquinoctialElements& elements);
absl::Status Validate(const KeplerianElements& elements);

// INVALID_ARGUMENT for what Validate refuses; an inclination of pi is the one singularity of the equinoctial form.
absl::StatusOr<EquinoctialElements> ToEquinoctial(const KeplerianElements& elements);

// INVALID_ARGUMENT for a radial trajectory (no plane), a hyperbolic or parabolic one, or an inclination of pi.
// true_longitude comes out in (-pi, pi].
absl::StatusOr<EquinoctialElements> ToEquinoctial(const CartesianState& state, double mu);

// Where an angle is undefined it is 0 by convention: the node of an equatorial orbit, the periapsis of a circular one;
// the true anomaly takes up what remains of the longitude. INVALID_ARGUMENT for what Validate refuses.
absl::StatusOr<KeplerianElements> ToKeplerian(const EquinoctialElements& elements);

absl::StatusOr<CartesianState> ToCartesian(const EquinoctialElements& elements, double mu);

// The unit vector from the central body to the spacecraft; needs only the longitude and the inclination vector.
Eigen::Vector3d RadialDirection(double sin_longitude, double cos_longitude, double hx, double hy);

}  // namespace orbitune
