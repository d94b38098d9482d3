// Gain sets out of jobs and campaigns, and the library out of the store.
#pragma once

#include "core/library/gain_library.h"
#include "storage/campaign.h"
#include "storage/job_store.h"

namespace orbitune {

// The gain set of a job that has succeeded: its best K, under the job's own id. prepared: of its (first) initial
// condition. lyapunov_decreasing: along the best K's trajectories in the report.
GainSet MakeGainSet(const JobRecord& job, const PreparedScenario& prepared, const JobReport& report,
                    bool lyapunov_decreasing, TimeUs now);

// K-hat of a campaign that has succeeded, as the members were flown under it; none where nothing was tuned. What a
// flight tells that was not measured (effort, V along the way) is left out; so is the id.
std::optional<GainSet> MakeMeanGainSet(const std::string& campaign_id, const CampaignSpec& spec,
                                       const CampaignResults& results, std::span<const CampaignMember> members,
                                       TimeUs now);

void AddToLibrary(std::span<const GainSet> sets, GainLibrary& library);

// Everything the store has. Errors: the store's.
absl::Status LoadLibrary(GainStore& store, GainLibrary& library);

}  // namespace orbitune
