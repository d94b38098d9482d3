#include "server/jobs/report.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/check.h"
#include "core/control/certificate.h"
#include "core/sim/severity.h"

namespace orbitune {
namespace {

// Costs gto-geo 0.2 % of its reduction.
constexpr double kDampingFloor = 0.05;

void WarnOfGains(std::vector<Warning>& warnings, const SearchOptions& options, const GainsAssessment& assessed) {
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

// The cost and its terms are the scalar simulator's, which is finer than the search's (docs/model.md, "Integration");
// the search's are left where that takes too many steps.
GainsAssessment AssessOne(const IterationRecord& record, EpisodeResult result, const PreparedScenario& prepared) {
  if (HasCost(record.outcome) && !HasCost(result.outcome)) {
    result.outcome = record.outcome;
    result.cost = record.cost;
    result.settling_samples = record.settling_samples;
    result.fuel_sum = record.fuel_sum;
  }
  return {record.iteration, record.gains, ToReport(result, prepared), std::nullopt};
}

// Of the values that are there.
Spread SpreadOf(const std::vector<double>& values) {
  Spread spread;
  double sum = 0;
  int count = 0;
  for (const double value : values) {
    if (std::isnan(value)) continue;
    spread.min = std::fmin(spread.min, value);
    spread.max = std::fmax(spread.max, value);
    sum += value;
    ++count;
  }
  if (count > 0) spread.mean = sum / count;
  return spread;
}

template <typename Value>
double Mean(const std::vector<EpisodeReport>& episodes, const Value& value) {
  double sum = 0;
  for (const EpisodeReport& episode : episodes) sum += value(episode);
  return sum / static_cast<double>(episodes.size());
}

// As GainsAssessment::episode says.
EpisodeReport Combine(const std::vector<EpisodeReport>& episodes) {
  const auto severity = [](const EpisodeReport& e) { return Severity(e.outcome); };
  const auto worst = std::ranges::max_element(episodes, {}, severity);
  EpisodeReport all{.outcome = worst->outcome};
  if (!worst->outcome_message.empty()) {
    all.outcome_message = absl::StrCat("initial condition ", worst - episodes.begin(), ": ", worst->outcome_message);
  }
  all.end_time_s = Mean(episodes, [](const auto& e) { return e.end_time_s; });
  if (HasCost(all.outcome)) {
    all.cost = Mean(episodes, [](const auto& e) { return e.cost; });
    all.settling_samples =
        static_cast<int>(std::lround(Mean(episodes, [](const auto& e) { return e.settling_samples; })));
    all.settling_time_s = Mean(episodes, [](const auto& e) { return e.settling_time_s; });
    all.fuel_sum = Mean(episodes, [](const auto& e) { return e.fuel_sum; });
  }
  all.delta_v_to_settling_m_s = Mean(episodes, [](const auto& e) { return e.delta_v_to_settling_m_s; });
  all.delta_v_horizon_m_s = Mean(episodes, [](const auto& e) { return e.delta_v_horizon_m_s; });
  all.domain_guaranteed = std::ranges::all_of(episodes, &EpisodeReport::domain_guaranteed);
  for (const EpisodeReport& e : episodes) {
    all.peak_acceleration_m_s2 = std::fmax(all.peak_acceleration_m_s2, e.peak_acceleration_m_s2);
    all.initial_lyapunov = std::fmax(all.initial_lyapunov, e.initial_lyapunov);
  }
  return all;
}

template <typename Value>
Spread ReductionPercent(std::span<const EpisodeResult> before, std::span<const EpisodeResult> after,
                        const Value& value) {
  std::vector<double> reductions;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const bool comparable = HasCost(before[i].outcome) && HasCost(after[i].outcome) && value(before[i]) > 0;
    if (comparable) reductions.push_back(100 * (1 - value(after[i]) / value(before[i])));
  }
  return SpreadOf(reductions);
}

// initial: the results under K(1).
GainsAssessment AssessEnsemble(const IterationRecord& record, std::span<const EpisodeResult> results,
                               std::span<const EpisodeResult> initial, std::span<const PreparedScenario> prepared) {
  std::vector<EpisodeReport> episodes;
  std::vector<double> costs;
  EnsembleReport ensemble{.initial_conditions = static_cast<int>(results.size()), .objective = record.cost};
  for (std::size_t i = 0; i < results.size(); ++i) {
    episodes.push_back(ToReport(results[i], prepared[i]));
    costs.push_back(results[i].cost);
    if (results[i].outcome == Outcome::kSettled) ++ensemble.settled;
  }
  ensemble.cost = SpreadOf(costs);
  ensemble.cost_reduction_percent = ReductionPercent(initial, results, [](const auto& r) { return r.cost; });
  ensemble.settling_time_reduction_percent =
      ReductionPercent(initial, results, [](const auto& r) { return 1.0 * r.settling_samples; });
  ensemble.fuel_sum_reduction_percent = ReductionPercent(initial, results, [](const auto& r) { return r.fuel_sum; });
  return {record.iteration, record.gains, Combine(episodes), ensemble};
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

JobReport BuildReport(const JobRecord& job, std::span<const PreparedScenario> prepared,
                      std::span<const EpisodeResult> results, std::int64_t pairs_left_out) {
  const std::size_t n = prepared.size();
  ORBITUNE_CHECK(results.size() == 3 * n && job.first && job.latest && job.best);
  const SearchOptions& options = job.spec.scenario.search;
  const auto assess = [&](const IterationRecord& record, std::size_t which) {
    return job.spec.initial_conditions.empty()
               ? AssessOne(record, results[which], prepared.front())
               : AssessEnsemble(record, results.subspan(which * n, n), results.first(n), prepared);
  };
  JobReport report;
  report.initial = assess(*job.first, 0);
  report.final = assess(*job.latest, 1);
  report.best = assess(*job.best, 2);
  report.episodes = job.latest->episodes;

  WarnOfGains(report.warnings, options, report.final);
  WarnOfEpisode(report.warnings, report.final, report.initial.episode);
  if (report.best.iteration != report.final.iteration) {
    // The last generation of a sampling search is no outcome of its own.
    if (options.algorithm == Algorithm::kArs && Better(*job.best, *job.latest)) {
      report.warnings.push_back(
          {WarningKind::kLastNotBest,
           absl::StrFormat("the last gains are not the best: J = %.6g at iteration %d, %.6g at iteration %d",
                           job.best->cost, job.best->iteration, job.latest->cost, job.latest->iteration)});
    }
    WarnOfGains(report.warnings, options, report.best);
    WarnOfEpisode(report.warnings, report.best, report.initial.episode);
  }
  if (pairs_left_out > 0) {
    const bool ars = options.algorithm == Algorithm::kArs;
    const std::int64_t tried = ars ? std::int64_t{job.latest->iteration} * options.directions
                                   : job.latest->episodes / static_cast<std::int64_t>(n);
    report.warnings.push_back({WarningKind::kPairsLeftOut,
                               absl::StrCat(pairs_left_out, " of ", tried, ars ? " pairs of episodes" : " candidates",
                                            " left the domain or failed, and were left out of the updates")});
  }
  return report;
}

}  // namespace orbitune
