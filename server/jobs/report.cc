#include "server/jobs/report.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/check.h"
#include "core/control/certificate.h"

namespace orbitune {
namespace {

// Costs gto-geo 0.2 % of its reduction.
constexpr double kDampingFloor = 0.05;

void WarnOfGains(std::vector<Warning>& warnings, const ArsOptions& options, const GainsAssessment& assessed) {
  for (std::size_t i = 0; i < kGainCount; ++i) {
    if (assessed.gains[i] > options.gain_floor) continue;
    std::string message = absl::StrFormat("K%d of iteration %d is on its floor of %g: the search would go lower", i + 1,
                                          assessed.iteration, options.gain_floor);
    if (options.gain_floor < kDampingFloor) {
      absl::StrAppend(&message, "; a larger floor (", kDampingFloor, ", say) keeps damping at little cost");
    }
    warnings.push_back({WarningKind::kGainAtFloor, std::move(message)});
  }
}

void WarnOfEpisode(std::vector<Warning>& warnings, const GainsAssessment& assessed, const EpisodeReport& before) {
  const EpisodeReport& after = assessed.episode;
  if (after.outcome != Outcome::kSettled) {
    warnings.push_back({WarningKind::kNotSettled,
                        absl::StrCat("under K of iteration ", assessed.iteration, ": ", after.outcome_message)});
  }
  if (after.peak_acceleration_m_s2 > kChemicalEngineLimitMS2) {
    warnings.push_back({WarningKind::kPeakAcceleration,
                        absl::StrFormat("K of iteration %d asks for %.3g m/s^2 at its peak: beyond a chemical engine's "
                                        "(about %g m/s^2)",
                                        assessed.iteration, after.peak_acceleration_m_s2, kChemicalEngineLimitMS2)});
  }
  if (after.delta_v_to_settling_m_s > before.delta_v_to_settling_m_s) {
    warnings.push_back(
        {WarningKind::kDeltaVRose,
         absl::StrFormat("the true delta-v rose from %.6g to %.6g m/s under K of iteration %d: the sum "
                         "of ||u(k)|| in the cost is a poor proxy for it here",
                         before.delta_v_to_settling_m_s, after.delta_v_to_settling_m_s, assessed.iteration)});
  }
}

// The cost and its terms are the search's, which the history shows; the scalar simulator, which measures the effort,
// agrees with them to the integration's tolerance only.
GainsAssessment Assess(const IterationRecord& record, EpisodeResult result, const PreparedScenario& prepared) {
  if (HasCost(record.outcome)) {
    result.outcome = record.outcome;
    result.cost = record.cost;
    result.settling_samples = record.settling_samples;
    result.fuel_sum = record.fuel_sum;
  }
  return {record.iteration, record.gains, ToReport(result, prepared)};
}

}  // namespace

EpisodeReport ToReport(const EpisodeResult& result, const PreparedScenario& prepared) {
  const CanonicalUnits& units = prepared.units;
  const EpisodeProblem& problem = prepared.problem;
  return {.outcome = result.outcome,
          .outcome_message = DescribeOutcome(result, prepared),
          .end_time_s = result.end_time * units.time_s,
          .cost = result.cost,
          .settling_samples = result.settling_samples,
          .settling_time_s = result.settling_samples * problem.sampling_period * units.time_s,
          .fuel_sum = result.fuel_sum,
          .delta_v_to_settling_m_s = result.delta_v_to_settling * units.velocity_m_s(),
          .delta_v_horizon_m_s = result.delta_v_horizon * units.velocity_m_s(),
          .peak_acceleration_m_s2 = result.peak_acceleration * units.acceleration_m_s2(),
          .initial_lyapunov = result.initial_lyapunov,
          .domain_guaranteed = StaysInDomain(result.initial_lyapunov, problem.target.eccentricity())};
}

JobReport BuildReport(const JobRecord& job, const PreparedScenario& prepared, std::span<const EpisodeResult> results,
                      std::int64_t pairs_left_out) {
  ORBITUNE_CHECK(results.size() == 3 && job.first && job.latest && job.best);
  const ArsOptions& options = job.spec.scenario.search;
  JobReport report;
  report.initial = Assess(*job.first, results[0], prepared);
  report.final = Assess(*job.latest, results[1], prepared);
  report.best = Assess(*job.best, results[2], prepared);
  report.episodes = std::int64_t{options.iterations} * (2 * options.directions + 1);

  WarnOfGains(report.warnings, options, report.final);
  WarnOfEpisode(report.warnings, report.final, report.initial.episode);
  if (report.best.iteration != report.final.iteration) {
    if (Better(*job.best, *job.latest)) {
      report.warnings.push_back(
          {WarningKind::kLastNotBest,
           absl::StrFormat("the last gains are not the best: J = %.6g at iteration %d, %.6g at iteration %d",
                           job.best->cost, job.best->iteration, job.latest->cost, job.latest->iteration)});
    }
    WarnOfGains(report.warnings, options, report.best);
    WarnOfEpisode(report.warnings, report.best, report.initial.episode);
  }
  if (pairs_left_out > 0) {
    report.warnings.push_back(
        {WarningKind::kPairsLeftOut,
         absl::StrCat(pairs_left_out, " of ", std::int64_t{options.iterations} * options.directions,
                      " pairs of episodes left the domain or failed, and were left out of the updates")});
  }
  return report;
}

}  // namespace orbitune
