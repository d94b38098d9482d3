// What comes of a campaign: the gains that stand for many initial conditions (the mean K-hat, the robust K), flown on
// the tuned and on the held-out ones, and compared.
#pragma once

#include <functional>
#include <span>

#include "storage/campaign.h"

namespace orbitune {

// A member whose job, if it has one, has ended.
struct EndedMember {
  CampaignMember member;
  JobState state = JobState::kSucceeded;  // of its job
  std::string error_message;              // likewise
  std::optional<JobReport> report;        // where the job succeeded
};

struct CampaignOutcome {
  CampaignResults results;
  std::vector<CampaignMember> members;  // the tuned and held-out ones, with their episodes
};

// Percentiles by linear interpolation between the order statistics: p at rank (n - 1) p / 100, counted from 0.
ReductionStatistics StatisticsOf(std::vector<double> values);

// The arithmetic mean, added up in order; gains not empty.
Gains MeanGains(std::span<const Gains> gains);

// The gains that a job is taken to have found, K*: the paper's K(M) with ARS, else its best.
const GainsAssessment& TunedGains(const JobReport& report, Algorithm algorithm);

// What a job's report says of K(1), K* and the best K.
std::vector<MemberEpisode> EpisodesOf(const JobReport& report, Algorithm algorithm);

// members: all of the campaign's, in order. Flies the episodes on the calling thread, some 10 to 500 us each; once
// `cancelled` says so the answer is CANCELLED. FAILED_PRECONDITION where no tuned member's job succeeded, with why.
// A function of its arguments alone.
absl::StatusOr<CampaignOutcome> CompareGains(const CampaignSpec& spec, std::span<const EndedMember> members,
                                             const std::function<bool()>& cancelled);

}  // namespace orbitune
