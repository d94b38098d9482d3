#include "core/library/flight.h"

#include <algorithm>

#include "core/control/certificate.h"
#include "core/sim/scalar_simulator.h"

namespace orbitune {
namespace {

// The integrator's error in a sampling period is a hundredth of the tolerance times the size of x, which it does not
// take below a hundredth of the settling distance (core/sim/scalar_simulator.cc); V is quadratic in x. What the
// tolerance, or thousands of steps at roundoff, make of it is no rise of V.
constexpr double kRoundoff = 1e-9;
constexpr double kNegligible = 1e-2;

bool Decreases(const std::vector<EpisodeSample>& samples, const EpisodeProblem& problem) {
  const double size = kNegligible * problem.settling_distance;
  for (std::size_t k = 1; k < samples.size(); ++k) {
    const double before = samples[k - 1].lyapunov;
    const double slack = std::max(problem.tolerance, kRoundoff) * std::max(before, size * size);
    if (!(samples[k].lyapunov <= before + slack)) return false;
  }
  return !samples.empty();
}

}  // namespace

WatchedEpisode FlyWatched(const EpisodeProblem& problem, const Gains& gains, EpisodeOptions options) {
  std::vector<EpisodeSample> own;
  options.measure_effort = true;
  if (options.trajectory == nullptr) options.trajectory = &own;
  WatchedEpisode episode{.result = SimulateEpisode(problem, gains, options)};
  episode.lyapunov_decreasing = Decreases(*options.trajectory, problem);
  return episode;
}

Flight ToFlight(const WatchedEpisode& episode, const PreparedScenario& prepared, const Gains& gains) {
  const EpisodeResult& result = episode.result;
  const CanonicalUnits& units = prepared.units;
  Flight flight{.outcome = result.outcome,
                .outcome_message = DescribeOutcome(result, prepared),
                .cost = result.cost,
                .settling_samples = result.settling_samples,
                .fuel_sum = result.fuel_sum,
                .delta_v_m_s = result.delta_v_to_settling * units.velocity_m_s(),
                .peak_acceleration_m_s2 = result.peak_acceleration * units.acceleration_m_s2()};
  if (HasCost(result.outcome)) {
    flight.settling_time_s = result.settling_samples * prepared.problem.sampling_period * units.time_s;
  }
  flight.certificate = {
      .gains_positive = std::ranges::all_of(gains, [](double gain) { return gain > 0; }),
      .domain_guaranteed = StaysInDomain(result.initial_lyapunov, prepared.problem.target.eccentricity()),
      .lyapunov_decreasing = episode.lyapunov_decreasing,
      .settled = result.outcome == Outcome::kSettled};
  return flight;
}

}  // namespace orbitune
