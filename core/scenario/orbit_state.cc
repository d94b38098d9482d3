#include "core/scenario/orbit_state.h"

#include <cmath>
#include <numbers>

#include "absl/strings/str_cat.h"

namespace orbitune {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

// Of an angle in degrees, and of the inclination vector: beyond, nothing meaningful is left of a sine or a square.
constexpr double kLargest = 1e6;

struct NamedValue {
  std::string_view field;
  double value;
};

absl::Status RequireFinite(std::initializer_list<NamedValue> values) {
  FieldErrors errors;
  for (const auto& [field, value] : values) {
    if (!std::isfinite(value)) errors.AddNumber(field, "a finite number", value);
  }
  return errors.ToStatus();
}

absl::Status RequireModerate(std::initializer_list<NamedValue> values) {
  FieldErrors errors;
  for (const auto& [field, value] : values) {
    if (!(std::abs(value) <= kLargest)) {
      errors.AddNumber(field, absl::StrCat("a finite number in [", -kLargest, ", ", kLargest, "]"), value);
    }
  }
  return errors.ToStatus();
}

absl::StatusOr<EquinoctialElements> ResolveForm(const std::monostate&, double) {
  FieldErrors errors;
  errors.Add("form", "one of keplerian, equinoctial, cartesian", "none");
  return errors.ToStatus();
}

absl::StatusOr<EquinoctialElements> ResolveForm(const KeplerianState& s, double) {
  FieldErrors errors;
  errors.Merge("keplerian",
               RequireModerate(
                   {{"raan_deg", s.raan_deg},
                    {"argument_of_periapsis_deg", s.argument_of_periapsis_deg},
                    {s.position == KeplerianState::Position::kTrueAnomaly ? "true_anomaly_deg" : "true_longitude_deg",
                     s.position_deg}}));
  if (!(std::isfinite(s.semi_major_axis_km) && s.semi_major_axis_km > 0)) {
    errors.AddNumber("keplerian.semi_major_axis_km", "> 0 and finite", s.semi_major_axis_km);
  }
  if (!(s.eccentricity >= 0 && s.eccentricity < 1)) {
    errors.AddNumber("keplerian.eccentricity", "in [0, 1), an ellipse", s.eccentricity);
  }
  if (!(s.inclination_deg >= 0 && s.inclination_deg < 180)) {
    errors.AddNumber("keplerian.inclination_deg", "in [0, 180): at 180 the equinoctial elements are singular",
                     s.inclination_deg);
  }
  if (!errors.empty()) return errors.ToStatus();
  const double longitude_of_periapsis_deg = s.argument_of_periapsis_deg + s.raan_deg;
  const bool anomaly = s.position == KeplerianState::Position::kTrueAnomaly;
  return ToEquinoctial(KeplerianElements{
      .semi_major_axis = s.semi_major_axis_km,
      .eccentricity = s.eccentricity,
      .inclination = s.inclination_deg * kDegree,
      .raan = s.raan_deg * kDegree,
      .argument_of_periapsis = s.argument_of_periapsis_deg * kDegree,
      .true_anomaly = (anomaly ? s.position_deg : s.position_deg - longitude_of_periapsis_deg) * kDegree});
}

absl::StatusOr<EquinoctialElements> ResolveForm(const EquinoctialState& s, double) {
  FieldErrors errors;
  errors.Merge(
      "equinoctial",
      RequireModerate(
          {{"ex", s.ex}, {"ey", s.ey}, {"hx", s.hx}, {"hy", s.hy}, {"true_longitude_deg", s.true_longitude_deg}}));
  if (!(std::isfinite(s.p_km) && s.p_km > 0)) errors.AddNumber("equinoctial.p_km", "> 0 and finite", s.p_km);
  const double e = std::hypot(s.ex, s.ey);
  if (e >= 1) errors.AddNumber("equinoctial.ex", "such that sqrt(ex^2 + ey^2) < 1, an ellipse", e);
  if (!errors.empty()) return errors.ToStatus();
  return EquinoctialElements{
      .true_longitude = s.true_longitude_deg * kDegree, .p = s.p_km, .ex = s.ex, .ey = s.ey, .hx = s.hx, .hy = s.hy};
}

absl::StatusOr<EquinoctialElements> ResolveForm(const CartesianStateKm& s, double mu_km3_s2) {
  FieldErrors errors;
  errors.Merge("cartesian", RequireFinite({{"x_km", s.x_km},
                                           {"y_km", s.y_km},
                                           {"z_km", s.z_km},
                                           {"x_dot_km_s", s.x_dot_km_s},
                                           {"y_dot_km_s", s.y_dot_km_s},
                                           {"z_dot_km_s", s.z_dot_km_s}}));
  if (!errors.empty()) return errors.ToStatus();
  auto elements = ToEquinoctial(
      CartesianState{.position = {s.x_km, s.y_km, s.z_km}, .velocity = {s.x_dot_km_s, s.y_dot_km_s, s.z_dot_km_s}},
      mu_km3_s2);
  if (!elements.ok()) {
    // What is wrong is a property of the whole state, not one of its six numbers.
    for (const FieldViolation& v : FieldViolationsOf(elements.status())) {
      errors.AddViolation({"cartesian", absl::StrCat("its ", v.field, " ", v.description)});
    }
    return errors.ToStatus();
  }
  return elements;
}

}  // namespace

absl::StatusOr<EquinoctialElements> Resolve(const OrbitState& state, double mu_km3_s2) {
  return std::visit([&](const auto& form) { return ResolveForm(form, mu_km3_s2); }, state);
}

}  // namespace orbitune
