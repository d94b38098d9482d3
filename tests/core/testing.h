// What the core's tests share: random orbits, states and episodes that are functions of their number alone, and a loop
// over two threads.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <random>

#include "core/scenario/scenario.h"

namespace orbitune::testing {

// Sanitized builds are some ten times slower: they look at fewer random cases, of the same kinds.
#ifdef ORBITUNE_SANITIZED
inline constexpr int kFewer = 20;
#else
inline constexpr int kFewer = 1;
#endif
constexpr int Cases(int n) { return n / kFewer; }

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}

  double Uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53;
  }
  double LogUniform(double low, double high) { return std::exp(Uniform(std::log(low), std::log(high))); }
  double Angle() { return Uniform(-3.14159, 3.14159); }
  double Normal() { return std::sqrt(-2 * std::log(Uniform(1e-300, 1))) * std::cos(Uniform(0, 6.283185307179586)); }

 private:
  std::mt19937_64 engine_;
};

// Canonical; the eccentricity anywhere in [0, largest_eccentricity], a quarter of them circular and equatorial.
TargetOrbit RandomTarget(Random& random, double largest_eccentricity);

// In the domain with a margin: 1 + x2 > 0.2 and a > 0.2.
ErrorState RandomState(Random& random, const TargetPhase& phase);

// Each in [0.03, 30].
Gains RandomGains(Random& random);

// Initial conditions as the paper draws them (docs/model.md, section 6).
KeplerianState RandomGtoGeoChaser(Random& random);
EquinoctialState RandomLeoChaser(Random& random, const Scenario& leo);

// A rendezvous with a target on an ellipse, e_r up to 0.6.
Scenario RandomEllipticScenario(Random& random);

struct RandomEpisode {
  EpisodeProblem problem{};
  Gains gains{};
};

// By turns: gto-geo, leo-rendezvous and elliptic targets, each with an initial condition and gains drawn for it, and
// now and then gto-geo-printed. The horizon is the scenario's own, unless the gains make the loop so stiff that it
// would take more than some 5,000 steps. Gains that put V(0) far above what keeps a loop inside the domain are drawn
// for every eighth episode only, and get ten samples: near the edge they cost a hundred times the work of the others.
RandomEpisode DrawEpisode(int number);

// task(0) .. task(n - 1), on two threads.
void ParallelFor(int n, const std::function<void(int)>& task);

// Same bits, or both NaN.
bool SameBits(double a, double b);

}  // namespace orbitune::testing
