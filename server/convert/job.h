// orbitune.v1 jobs, iterations, episodes and events <-> the domain's.
#pragma once

#include "orbitune/v1/tuning.pb.h"
#include "server/convert/orbit.h"

namespace orbitune {

// Output-only fields are ignored.
absl::StatusOr<NewJob> FromProto(const v1::Job& job);
absl::StatusOr<EpisodeRequest> FromProto(const v1::SimulateEpisodeRequest& request);

// A record that was only validated has no id, and then no state, times or etag.
void ToProto(const JobRecord& record, v1::Job* out);
void ToProto(const IterationRecord& record, v1::Iteration* out);
void ToProto(const JobReport& report, v1::JobReport* out);
void ToProto(const EpisodeReport& report, v1::EpisodeResult* out);
void ToProto(const JobEvent& event, v1::WatchJobResponse* out);
void ToProto(const EpisodeAnswer& answer, v1::SimulateEpisodeResponse* out);

v1::JobState ToProto(JobState state);
v1::Outcome ToProto(Outcome outcome);
void SetTime(TimeUs time_us, google::protobuf::Timestamp* out);

// name: scenarios/ID or "". INVALID_ARGUMENT for "scenario", and as FromProto's of a scenario.
absl::StatusOr<ScenarioChoice> ChoiceFromProto(const std::string& name, bool has_definition,
                                               const v1::Scenario& definition);

}  // namespace orbitune
