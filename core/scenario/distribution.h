// Distributions of initial conditions over orbital elements, and draws from them: each a function of (seed, set, index)
// alone, so that any one can be drawn again.
#pragma once

#include <cstdint>
#include <variant>
#include <vector>

#include "core/scenario/orbit_state.h"

namespace orbitune {

struct FixedValue {
  double value = 0;
};
struct UniformVariate {
  double low = 0;
  double high = 0;
};
struct NormalVariate {
  double mean = 0;
  double standard_deviation = 0;
};
// One element's value, in the element's unit.
using Variate = std::variant<FixedValue, UniformVariate, NormalVariate>;

struct KeplerianDistribution {
  Variate semi_major_axis_km;
  Variate eccentricity;
  Variate inclination_deg;
  Variate raan_deg;
  Variate argument_of_periapsis_deg;
  KeplerianState::Position position = KeplerianState::Position::kTrueAnomaly;
  Variate position_deg;
  // The longitude of periapsis changes its sign once omega' and Omega are drawn: omega = -omega' - 2 Omega.
  bool mirrored_periapsis = false;
};

struct EquinoctialDistribution {
  Variate p_km;
  Variate ex;
  Variate ey;
  Variate hx;
  Variate hy;
  Variate true_longitude_deg;
};

// std::monostate: none.
using IcDistribution = std::variant<std::monostate, KeplerianDistribution, EquinoctialDistribution>;

// OK, or INVALID_ARGUMENT naming the fields (as they are called above, "keplerian.raan_deg" and so on) whose numbers
// are not finite, whose range is upside down or whose deviation is negative; and where there is no distribution at all.
absl::Status Validate(const IcDistribution& distribution);

// Draws for tuning, and others from the same distribution to hold the outcome against.
enum class DrawSet { kTuning, kHeldOut };

// The draw of this index; distribution valid. One that is no ellipse is drawn again, 1000 times at most: then
// INVALID_ARGUMENT.
absl::StatusOr<OrbitState> Draw(const IcDistribution& distribution, std::uint64_t seed, DrawSet set,
                                std::uint32_t index);

// Draws first .. first + count - 1. INVALID_ARGUMENT as Validate's and Draw's.
absl::StatusOr<std::vector<OrbitState>> DrawMany(const IcDistribution& distribution, std::uint64_t seed, DrawSet set,
                                                 std::uint32_t first, std::uint32_t count);

}  // namespace orbitune
