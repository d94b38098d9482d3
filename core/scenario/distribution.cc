#include "core/scenario/distribution.h"

#include <array>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/base/random.h"

namespace orbitune {
namespace {

// No element of an orbit is larger, in whatever unit.
constexpr char kSensible[] = "in [-1e9, 1e9]";
bool Sensible(double value) { return std::abs(value) <= 1e9; }

constexpr std::uint32_t kMostAttempts = 1000;
// Whether a state is an ellipse does not depend on it in the forms that are drawn.
constexpr double kAnyMu = 1;

// visit(name, variate), in the order in which the elements are drawn.
template <typename V>
void VisitVariates(const KeplerianDistribution& d, V&& visit) {
  const bool longitude = d.position == KeplerianState::Position::kTrueLongitude;
  visit("semi_major_axis_km", d.semi_major_axis_km);
  visit("eccentricity", d.eccentricity);
  visit("inclination_deg", d.inclination_deg);
  visit("raan_deg", d.raan_deg);
  visit("argument_of_periapsis_deg", d.argument_of_periapsis_deg);
  visit(longitude ? "true_longitude_deg" : "true_anomaly_deg", d.position_deg);
}

template <typename V>
void VisitVariates(const EquinoctialDistribution& d, V&& visit) {
  visit("p_km", d.p_km);
  visit("ex", d.ex);
  visit("ey", d.ey);
  visit("hx", d.hx);
  visit("hy", d.hy);
  visit("true_longitude_deg", d.true_longitude_deg);
}

void Check(FieldErrors& errors, const std::string& field, const FixedValue& v) {
  if (!Sensible(v.value)) errors.AddNumber(absl::StrCat(field, ".fixed"), kSensible, v.value);
}

void Check(FieldErrors& errors, const std::string& field, const UniformVariate& v) {
  if (!Sensible(v.low)) errors.AddNumber(absl::StrCat(field, ".uniform.low"), kSensible, v.low);
  if (!(Sensible(v.high) && v.high >= v.low)) {
    errors.AddNumber(absl::StrCat(field, ".uniform.high"),
                     absl::StrCat(">= low = ", FormatNumber(v.low), ", at most 1e9"), v.high);
  }
}

void Check(FieldErrors& errors, const std::string& field, const NormalVariate& v) {
  if (!Sensible(v.mean)) errors.AddNumber(absl::StrCat(field, ".normal.mean"), kSensible, v.mean);
  if (!(Sensible(v.standard_deviation) && v.standard_deviation >= 0)) {
    errors.AddNumber(absl::StrCat(field, ".normal.standard_deviation"), "in [0, 1e9]", v.standard_deviation);
  }
}

template <typename Form>
void CheckAll(FieldErrors& errors, std::string_view form, const Form& d) {
  VisitVariates(d, [&](const char* name, const Variate& variate) {
    std::visit([&](const auto& v) { Check(errors, absl::StrCat(ToAbsl(form), ".", name), v); }, variate);
  });
}

double Value(const FixedValue& v, const RandomKey&, std::uint32_t) { return v.value; }
double Value(const UniformVariate& v, const RandomKey& key, std::uint32_t element) {
  return v.low + (v.high - v.low) * StandardUniform(key, element);
}
double Value(const NormalVariate& v, const RandomKey& key, std::uint32_t element) {
  return v.mean + v.standard_deviation * StandardNormal(key, element);
}

// The elements' values, in the order of VisitVariates. Uniform and normal draws of one element use other components of
// the counter (StandardNormal takes two elements to one), so that neither repeats the other's bits.
template <typename Form>
std::array<double, 6> Values(const Form& d, const RandomKey& key) {
  std::array<double, 6> values{};
  std::uint32_t element = 0;
  VisitVariates(d, [&](const char*, const Variate& variate) {
    const std::uint32_t component = std::holds_alternative<UniformVariate>(variate) ? 16 + element : element;
    values[element] = std::visit([&](const auto& v) { return Value(v, key, component); }, variate);
    ++element;
  });
  return values;
}

OrbitState DrawForm(const std::monostate&, const RandomKey&) { return {}; }

OrbitState DrawForm(const KeplerianDistribution& d, const RandomKey& key) {
  const auto [a, e, i, raan, argument, position] = Values(d, key);
  return KeplerianState{.semi_major_axis_km = a,
                        .eccentricity = e,
                        .inclination_deg = i,
                        .raan_deg = raan,
                        .argument_of_periapsis_deg = d.mirrored_periapsis ? -argument - 2 * raan : argument,
                        .position = d.position,
                        .position_deg = position};
}

OrbitState DrawForm(const EquinoctialDistribution& d, const RandomKey& key) {
  const auto [p, ex, ey, hx, hy, longitude] = Values(d, key);
  return EquinoctialState{.p_km = p, .ex = ex, .ey = ey, .hx = hx, .hy = hy, .true_longitude_deg = longitude};
}

}  // namespace

absl::Status Validate(const IcDistribution& distribution) {
  FieldErrors errors;
  if (const auto* keplerian = std::get_if<KeplerianDistribution>(&distribution)) {
    CheckAll(errors, "keplerian", *keplerian);
  } else if (const auto* equinoctial = std::get_if<EquinoctialDistribution>(&distribution)) {
    CheckAll(errors, "equinoctial", *equinoctial);
  } else {
    errors.Add("form", "keplerian or equinoctial", "none");
  }
  return errors.ToStatus();
}

absl::StatusOr<OrbitState> Draw(const IcDistribution& distribution, std::uint64_t seed, DrawSet set,
                                std::uint32_t index) {
  const RandomStream stream =
      set == DrawSet::kTuning ? RandomStream::kInitialConditions : RandomStream::kHeldOutInitialConditions;
  absl::Status fault;
  for (std::uint32_t attempt = 0; attempt < kMostAttempts; ++attempt) {
    const RandomKey key{.seed = seed, .stream = stream, .a = index, .b = attempt};
    OrbitState state = std::visit([&](const auto& form) { return DrawForm(form, key); }, distribution);
    fault = Resolve(state, kAnyMu).status();
    if (fault.ok()) return state;
  }
  return absl::InvalidArgumentError(absl::StrCat("none of ", kMostAttempts, " draws from the distribution is an ",
                                                 "ellipse; the last: ", fault.message()));
}

absl::StatusOr<std::vector<OrbitState>> DrawMany(const IcDistribution& distribution, std::uint64_t seed, DrawSet set,
                                                 std::uint32_t first, std::uint32_t count) {
  if (absl::Status status = Validate(distribution); !status.ok()) return status;
  std::vector<OrbitState> states;
  for (std::uint32_t i = 0; i < count; ++i) {
    auto state = Draw(distribution, seed, set, first + i);
    if (!state.ok()) return state.status();
    states.push_back(*std::move(state));
  }
  return states;
}

}  // namespace orbitune
