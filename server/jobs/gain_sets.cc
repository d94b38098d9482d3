#include "server/jobs/gain_sets.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "absl/strings/str_cat.h"
#include "core/base/version.h"
#include "core/library/scenario_digest.h"
#include "core/sim/severity.h"
#include "storage/serialise.h"

namespace orbitune {
namespace {

Flight ToFlight(const GainsAssessment& best, bool lyapunov_decreasing) {
  const EpisodeReport& episode = best.episode;
  return {.outcome = episode.outcome,
          .outcome_message = episode.outcome_message,
          .cost = episode.cost,
          .settling_samples = episode.settling_samples,
          .settling_time_s = episode.settling_time_s,
          .fuel_sum = episode.fuel_sum,
          .delta_v_m_s = episode.delta_v_to_settling_m_s,
          .peak_acceleration_m_s2 = episode.peak_acceleration_m_s2,
          .certificate = {.gains_positive = std::ranges::all_of(best.gains, [](double gain) { return gain > 0; }),
                          .domain_guaranteed = episode.domain_guaranteed,
                          .lyapunov_decreasing = lyapunov_decreasing,
                          .settled = episode.outcome == Outcome::kSettled}};
}

// Over the tuned members as they were flown under the mean: the worst outcome, and the means of what all have.
Flight MeanFlight(const Gains& gains, const PreparedScenario& prepared, std::span<const CampaignMember> members) {
  Flight flight{.outcome = Outcome::kSettled, .cost = 0, .settling_time_s = 0, .fuel_sum = 0};
  double count = 0;
  double samples = 0;
  for (const CampaignMember& member : members) {
    if (member.id.role != MemberRole::kTuned) continue;
    for (const MemberEpisode& episode : member.episodes) {
      if (episode.choice != GainsChoice::kMean) continue;
      ++count;
      if (Severity(episode.outcome) > Severity(flight.outcome)) flight.outcome = episode.outcome;
      flight.cost += episode.cost;
      flight.fuel_sum += episode.fuel_sum;
      samples += episode.settling_samples;
    }
  }
  if (count == 0) flight.outcome = Outcome::kNumericalFailure;
  flight.cost /= count;
  flight.fuel_sum /= count;
  flight.settling_samples = count > 0 ? static_cast<int>(std::lround(samples / count)) : 0;
  flight.settling_time_s = samples / count * prepared.problem.sampling_period * prepared.units.time_s;
  flight.certificate.gains_positive = std::ranges::all_of(gains, [](double gain) { return gain > 0; });
  flight.certificate.settled = flight.outcome == Outcome::kSettled;
  return flight;
}

}  // namespace

GainSet MakeGainSet(const JobRecord& job, const PreparedScenario& prepared, const JobReport& report,
                    bool lyapunov_decreasing, TimeUs now) {
  const JobSpec& spec = job.spec;
  GainSet set;
  set.id = job.id;
  set.kind = spec.initial_conditions.empty() ? GainSetKind::kTuned : GainSetKind::kRobust;
  set.display_name = spec.display_name;
  set.create_time_us = now;
  set.gains = report.best.gains;
  set.velocity_unit_m_s = prepared.velocity_unit_m_s;
  set.acceleration_unit_m_s2 = prepared.acceleration_unit_m_s2;
  set.scenario = LibraryDefinition(spec.scenario);
  set.scenario_digest = ScenarioDigest(spec.scenario);
  if (set.kind == GainSetKind::kTuned) {
    set.initial_condition = spec.initial_condition;
    set.initial_error = prepared.problem.initial_error;
  }
  set.job_id = job.id;
  set.campaign_id = spec.campaign_id;
  set.iteration = report.best.iteration;
  set.algorithm = NameOf(spec.scenario.search.algorithm);
  set.seed = spec.scenario.search.seed;
  set.engine_version = EngineVersion();
  if (job.provenance) set.history_digest = ToHex(job.provenance->digest);
  set.flight = ToFlight(report.best, lyapunov_decreasing);
  return set;
}

std::optional<GainSet> MakeMeanGainSet(const std::string& campaign_id, const CampaignSpec& spec,
                                       const CampaignResults& results, std::span<const CampaignMember> members,
                                       TimeUs now) {
  const auto prepared = Prepare(spec.scenario);
  if (results.mean_of == 0 || !prepared.ok()) return std::nullopt;
  GainSet set;
  set.kind = GainSetKind::kMean;
  set.display_name = absl::StrCat("mean of ", results.mean_of, " tuned");
  set.create_time_us = now;
  set.gains = results.mean_gains;
  set.velocity_unit_m_s = prepared->velocity_unit_m_s;
  set.acceleration_unit_m_s2 = prepared->acceleration_unit_m_s2;
  set.scenario = LibraryDefinition(spec.scenario);
  set.scenario_digest = ScenarioDigest(spec.scenario);
  set.campaign_id = campaign_id;
  set.algorithm = NameOf(spec.scenario.search.algorithm);
  set.seed = spec.scenario.search.seed;
  set.engine_version = EngineVersion();
  set.flight = MeanFlight(set.gains, *prepared, members);
  return set;
}

void AddToLibrary(std::span<const GainSet> sets, GainLibrary& library) {
  std::map<std::string_view, std::vector<LibraryEntry>> by_digest;
  for (const GainSet& set : sets) by_digest[set.scenario_digest].push_back(ToLibraryEntry(set));
  for (const GainSet& set : sets) {
    const auto entries = by_digest.extract(set.scenario_digest);
    if (!entries.empty()) library.Add(set.scenario_digest, set.scenario, entries.mapped());
  }
}

absl::Status LoadLibrary(GainStore& store, GainLibrary& library) {
  return store.ReadLibrary(
      [&library](const std::string& digest, const Scenario& definition, const std::vector<LibraryEntry>& entries) {
        library.Add(digest, definition, entries);
      });
}

}  // namespace orbitune
