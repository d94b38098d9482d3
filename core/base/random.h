// Counter-based random numbers: each draw is a function of its coordinates alone, so that a search resumed anywhere,
// on any number of threads, sees the same ones.
#pragma once

#include <cstdint>

namespace orbitune {

// One standard normal variate for each (seed, stream, a, b, component); Philox4x32-10 (Salmon et al. 2011) and the
// Box-Muller transform. `stream` separates uses: the search's directions from a distribution's draws.
enum class RandomStream : std::uint32_t {
  kSearchDirections = 1,
  kInitialConditions = 2,
  kHeldOutInitialConditions = 3,
  kCmaEs = 4,
};

struct RandomKey {
  std::uint64_t seed = 0;
  RandomStream stream = RandomStream::kSearchDirections;
  std::uint32_t a = 0;  // e.g. the iteration
  std::uint32_t b = 0;  // e.g. the direction
};

double StandardNormal(const RandomKey& key, std::uint32_t component);

// Uniform in (0, 1].
double StandardUniform(const RandomKey& key, std::uint32_t component);

}  // namespace orbitune
