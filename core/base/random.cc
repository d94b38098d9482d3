#include "core/base/random.h"

#include <Random123/philox.h>

#include <cmath>
#include <numbers>

namespace orbitune {
namespace {

struct UniformPair {
  double first;
  double second;
};

// 53 random bits, centred in their cell: never 0.
double ToUniform(std::uint32_t high, std::uint32_t low) {
  const std::uint64_t bits = (static_cast<std::uint64_t>(high) << 32 | low) >> 11;
  return (static_cast<double>(bits) + 0.5) * 0x1p-53;
}

UniformPair DrawPair(const RandomKey& key, std::uint32_t component) {
  const r123::Philox4x32::key_type philox_key{
      {static_cast<std::uint32_t>(key.seed), static_cast<std::uint32_t>(key.seed >> 32)}};
  const r123::Philox4x32::ctr_type counter{{component, key.b, key.a, static_cast<std::uint32_t>(key.stream)}};
  const auto bits = r123::Philox4x32()(counter, philox_key);
  return {ToUniform(bits[0], bits[1]), ToUniform(bits[2], bits[3])};
}

}  // namespace

double StandardUniform(const RandomKey& key, std::uint32_t component) { return DrawPair(key, component).first; }

double StandardNormal(const RandomKey& key, std::uint32_t component) {
  const UniformPair pair = DrawPair(key, component / 2);
  const double radius = std::sqrt(-2 * std::log(pair.first));
  const double angle = 2 * std::numbers::pi * pair.second;
  return radius * (component % 2 == 0 ? std::cos(angle) : std::sin(angle));
}

}  // namespace orbitune
