#include "storage/serialise.h"

#include <algorithm>

#include "storage/serialise_codec.h"

namespace orbitune {
namespace {

using serialise::Dump;
using serialise::Encode;
using serialise::FromJson;
using serialise::Json;
using serialise::kNames;

// DATA_LOSS where it is not the name of `what`.
template <typename E>
absl::StatusOr<E> ValueOf(std::string_view name, std::string_view what) {
  const auto found = std::ranges::find(kNames<E>, name);
  if (found != kNames<E>.end()) return static_cast<E>(found - kNames<E>.begin());
  return absl::DataLossError(absl::StrCat(FormatReceived(name), " is not the name of ", ToAbsl(what)));
}

}  // namespace

std::string_view NameOf(Algorithm algorithm) { return kNames<Algorithm>[static_cast<std::size_t>(algorithm)]; }

std::string_view NameOf(GainSetKind kind) { return kNames<GainSetKind>[static_cast<std::size_t>(kind)]; }

std::string_view NameOf(JobState state) { return kNames<JobState>[static_cast<std::size_t>(state)]; }

absl::StatusOr<JobState> JobStateOf(std::string_view name) { return ValueOf<JobState>(name, "a job's state"); }

absl::StatusOr<GainSetKind> GainSetKindOf(std::string_view name) {
  return ValueOf<GainSetKind>(name, "a gain set's kind");
}

absl::StatusOr<std::string> ToJson(const JobSpec& spec) {
  try {
    return Encode(spec).dump();
  } catch (const Json::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("the job has a text that is not UTF-8: ", e.what()));
  }
}

std::string ToJson(const JobReport& report) { return Dump(Encode(report)); }

absl::StatusOr<JobSpec> JobSpecFromJson(std::string_view text) { return FromJson<JobSpec>(text, "spec"); }

absl::StatusOr<JobReport> JobReportFromJson(std::string_view text) { return FromJson<JobReport>(text, "report"); }

std::string ToJson(const Scenario& scenario) { return Dump(Encode(scenario)); }

absl::StatusOr<Scenario> ScenarioFromJson(std::string_view text) { return FromJson<Scenario>(text, "scenario"); }

std::string ToJson(const Provenance& provenance) { return Encode(provenance).dump(); }

std::string ToJson(const EngineStretch& stretch) { return Encode(stretch).dump(); }

absl::StatusOr<Provenance> ProvenanceFromJson(std::string_view text) {
  return FromJson<Provenance>(text, "provenance");
}

std::string GainSetDocument(const GainSet& set) { return Dump(Encode(set)); }

absl::Status ReadGainSetDocument(std::string_view text, GainSet& set) {
  absl::StatusOr<GainSet> read = FromJson<GainSet>(text, "gain set");
  if (read.ok()) set = *std::move(read);
  return read.status();
}

std::string_view NameOf(CampaignState state) { return kNames<CampaignState>[static_cast<std::size_t>(state)]; }

absl::StatusOr<CampaignState> CampaignStateOf(std::string_view name) {
  return ValueOf<CampaignState>(name, "a campaign's state");
}

absl::StatusOr<std::string> ToJson(const CampaignSpec& spec) {
  try {
    return Encode(spec).dump();
  } catch (const Json::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("the campaign has a text that is not UTF-8: ", e.what()));
  }
}

std::string ToJson(const CampaignResults& results) { return Dump(Encode(results)); }

std::string ToJson(const std::vector<MemberEpisode>& episodes) { return Encode(episodes).dump(); }

std::string ToJson(const OrbitState& state) { return Encode(state).dump(); }

std::string ToJson(const InitialConditionDraws& draws) { return Encode(draws).dump(); }

absl::StatusOr<CampaignSpec> CampaignSpecFromJson(std::string_view text) {
  return FromJson<CampaignSpec>(text, "spec");
}

absl::StatusOr<CampaignResults> CampaignResultsFromJson(std::string_view text) {
  return FromJson<CampaignResults>(text, "results");
}

absl::StatusOr<std::vector<MemberEpisode>> MemberEpisodesFromJson(std::string_view text) {
  return FromJson<std::vector<MemberEpisode>>(text, "episodes");
}

absl::StatusOr<OrbitState> OrbitStateFromJson(std::string_view text) {
  return FromJson<OrbitState>(text, "initial_condition");
}

}  // namespace orbitune
