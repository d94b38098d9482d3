// Jobs' inputs and reports as JSON text, field for field as the structs name them; doubles keep every bit (NaN,
// whatever its bits, is null; infinities are texts). The one place that knows JSON. Functions only: thread-safe.
#pragma once

#include <string>
#include <string_view>

#include "storage/campaign.h"
#include "storage/job.h"

namespace orbitune {

// "QUEUED", "RUNNING", ...
std::string_view NameOf(JobState state);
// "ARS", "CMA_ES", "NELDER_MEAD".
std::string_view NameOf(Algorithm algorithm);
// DATA_LOSS for any other text.
absl::StatusOr<JobState> JobStateOf(std::string_view name);

// INVALID_ARGUMENT if a text of the spec is not UTF-8.
absl::StatusOr<std::string> ToJson(const JobSpec& spec);

// What is not UTF-8 in a message is replaced by U+FFFD: a report is never refused.
std::string ToJson(const JobReport& report);

// DATA_LOSS, naming the field, unless every field is there, of its kind and in its range, and no other. A field that an
// earlier version did not have may be missing, and is at its default then.
absl::StatusOr<JobSpec> JobSpecFromJson(std::string_view text);
absl::StatusOr<JobReport> JobReportFromJson(std::string_view text);

// Likewise.
std::string ToJson(const Scenario& scenario);
absl::StatusOr<Scenario> ScenarioFromJson(std::string_view text);

// All but the newest digest, which has a column of its own.
std::string ToJson(const Provenance& provenance);
std::string ToJson(const EngineStretch& stretch);
absl::StatusOr<Provenance> ProvenanceFromJson(std::string_view text);

// Of a gain set what the columns of its table do not hold.
std::string GainSetDocument(const GainSet& set);
absl::Status ReadGainSetDocument(std::string_view text, GainSet& set);

// Likewise of campaigns.
std::string_view NameOf(CampaignState state);
absl::StatusOr<CampaignState> CampaignStateOf(std::string_view name);
absl::StatusOr<std::string> ToJson(const CampaignSpec& spec);
std::string ToJson(const CampaignResults& results);
std::string ToJson(const std::vector<MemberEpisode>& episodes);
std::string ToJson(const OrbitState& state);
std::string ToJson(const InitialConditionDraws& draws);
absl::StatusOr<CampaignSpec> CampaignSpecFromJson(std::string_view text);
absl::StatusOr<CampaignResults> CampaignResultsFromJson(std::string_view text);
absl::StatusOr<std::vector<MemberEpisode>> MemberEpisodesFromJson(std::string_view text);
absl::StatusOr<OrbitState> OrbitStateFromJson(std::string_view text);

}  // namespace orbitune
