#include "server/api/simulation.h"

#include "server/api/answer.h"
#include "server/convert/job.h"

namespace orbitune {

void SimulationApi::AddTo(MethodTable& methods) {
  methods.Add("orbitune.v1.SimulationService.SimulateEpisode", Work::kEpisode, this, &SimulationApi::SimulateEpisode);
}

absl::Status SimulationApi::SimulateEpisode(const v1::SimulateEpisodeRequest& request, v1::SimulateEpisodeResponse* out,
                                            const Cancelled& cancelled) {
  if (cancelled()) return absl::CancelledError("nobody waits for the episode any more");
  const auto episode = FromProto(request);
  return episode.ok() ? Answer(use_cases_.SimulateEpisode(*episode, cancelled), out) : episode.status();
}

}  // namespace orbitune
