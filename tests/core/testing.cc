#include "tests/core/testing.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <numbers>
#include <thread>

#include "core/base/check.h"
#include "core/scenario/presets.h"

namespace orbitune::testing {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

EpisodeProblem ProblemOf(const Scenario& scenario, const OrbitState& chaser = {}) {
  const auto prepared = Prepare(scenario, chaser);
  ORBITUNE_CHECK(prepared.ok());
  return prepared->problem;
}

double InitialLyapunov(const RandomEpisode& episode) {
  const EpisodeProblem& problem = episode.problem;
  const TargetPhase phase = problem.target.PhaseAt(problem.target.initial_longitude);
  const CanonicalGains k = ToCanonical(episode.gains, problem.gain_units);
  return EvaluateLaw(problem.initial_error, problem.target, phase, k).lyapunov;
}

// The fastest rate of the closed loop near the target is K2, K3, K4, or K5 times the squared effect of u_h on V.
double FastestRate(const EpisodeProblem& problem, const CanonicalGains& k) {
  const double h2 = problem.target.hx * problem.target.hx + problem.target.hy * problem.target.hy;
  const double effect = (1 + h2) / 2 + 2 * k.k1 * std::sqrt(h2);
  return std::max({k.k2, k.k3, k.k4, k.k5 * effect * effect});
}

void ShortenIfStiff(RandomEpisode& episode) {
  EpisodeProblem& problem = episode.problem;
  const double rate = FastestRate(problem, ToCanonical(episode.gains, problem.gain_units));
  constexpr double kSteps = 5'000, kStepTimesRate = 3.3;  // the explicit method's limit
  double samples = kSteps * kStepTimesRate / (rate * problem.sampling_period);
  if (InitialLyapunov(episode) > 1) samples = 10;  // leaves the domain by then, or comes so near to it as to stay stiff
  problem.horizon_samples = static_cast<int>(std::clamp(samples, 10.0, 1.0 * problem.horizon_samples));
}

}  // namespace

TargetOrbit RandomTarget(Random& random, double largest_eccentricity) {
  TargetOrbit target{.initial_longitude = random.Angle()};
  if (random.Uniform(0, 1) < 0.25) return target;
  const double e = random.Uniform(0, largest_eccentricity);
  const double periapsis = random.Angle();
  target.ex = e * std::cos(periapsis);
  target.ey = e * std::sin(periapsis);
  target.hx = random.Uniform(-1, 1);
  target.hy = random.Uniform(-1, 1);
  return target;
}

ErrorState RandomState(Random& random, const TargetPhase& phase) {
  // Below a = 1 + zeta_X: x3 from just above the edge to as far on the other side.
  const double inverse_radius = random.Uniform(0.2, 2 * (1 + phase.zeta_x));
  return {.x1 = random.Angle(),
          .x2 = random.Uniform(-0.8, 0.8),
          .x3 = inverse_radius - 1 - phase.zeta_x,
          .x4 = random.Uniform(-1, 1),
          .x5 = random.Uniform(-1, 1),
          .x6 = random.Uniform(-1, 1)};
}

Gains RandomGains(Random& random) {
  Gains gains;
  for (double& k : gains) k = random.LogUniform(0.03, 30);
  return gains;
}

KeplerianState RandomGtoGeoChaser(Random& random) {
  const double raan = random.Uniform(45, 90);
  const double longitude_of_periapsis = -(random.Uniform(45, 90) + raan);
  return {.semi_major_axis_km = 24364,
          .eccentricity = 0.7306,
          .inclination_deg = random.Uniform(45, 90),
          .raan_deg = raan,
          .argument_of_periapsis_deg = longitude_of_periapsis - raan,
          .position = KeplerianState::Position::kTrueLongitude,
          .position_deg = 30};
}

EquinoctialState RandomLeoChaser(Random& random, const Scenario& leo) {
  EquinoctialState chaser = std::get<EquinoctialState>(leo.target);
  chaser.true_longitude_deg += 0.5 * random.Normal();
  chaser.p_km += 20 * random.Normal();
  chaser.ex += 3e-5 * random.Normal();
  chaser.ey += 3e-5 * random.Normal();
  chaser.hx += 2e-3 * random.Normal();
  chaser.hy += 2e-3 * random.Normal();
  return chaser;
}

Scenario RandomEllipticScenario(Random& random) {
  const TargetOrbit orbit = RandomTarget(random, 0.6);
  const EquinoctialState target{.p_km = random.Uniform(11000, 14000),
                                .ex = orbit.ex,
                                .ey = orbit.ey,
                                .hx = orbit.hx,
                                .hy = orbit.hy,
                                .true_longitude_deg = orbit.initial_longitude / kDegree};
  EquinoctialState chaser = target;
  chaser.p_km *= random.Uniform(0.97, 1.03);
  chaser.ex += random.Uniform(-0.02, 0.02);
  chaser.ey += random.Uniform(-0.02, 0.02);
  chaser.hx += random.Uniform(-0.03, 0.03);
  chaser.hy += random.Uniform(-0.03, 0.03);
  chaser.true_longitude_deg += random.Uniform(-6, 6);
  Scenario scenario;
  scenario.target = target;
  scenario.chaser = chaser;
  scenario.sampling_period_s = 300;
  scenario.horizon_samples = 1280;
  scenario.fuel_weight = 100;
  scenario.settling_distance_km = 2;
  return scenario;
}

RandomEpisode DrawEpisode(int number) {
  Random random(static_cast<std::uint64_t>(number) + 1);
  RandomEpisode episode;
  const Scenario& leo = *FindPreset("leo-rendezvous");
  episode.problem = number % 16 == 15 ? ProblemOf(*FindPreset("gto-geo-printed"))
                    : number % 3 == 0 ? ProblemOf(*FindPreset("gto-geo"), RandomGtoGeoChaser(random))
                    : number % 3 == 1 ? ProblemOf(leo, RandomLeoChaser(random, leo))
                                      : ProblemOf(RandomEllipticScenario(random));
  // Some initial conditions are far off under any gains.
  int tries = 0;
  do {
    episode.gains = RandomGains(random);
  } while (number % 8 != 7 && InitialLyapunov(episode) > 1 && ++tries < 100);
  ShortenIfStiff(episode);
  return episode;
}

void ParallelFor(int n, const std::function<void(int)>& task) {
  std::atomic<int> next = 0;
  const auto work = [&] {
    for (int i = next++; i < n; i = next++) task(i);
  };
  std::thread other(work);
  work();
  other.join();
}

bool SameBits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b) || (std::isnan(a) && std::isnan(b));
}

}  // namespace orbitune::testing
