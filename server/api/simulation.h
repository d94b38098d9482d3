// SimulationService in protobuf, without a transport.
#pragma once

#include "orbitune/v1/simulation.pb.h"
#include "server/api/methods.h"
#include "server/service/use_cases.h"

namespace orbitune {

// Thread-safe.
class SimulationApi {
 public:
  explicit SimulationApi(UseCases& use_cases) : use_cases_(use_cases) {}

  void AddTo(MethodTable& methods);

 private:
  absl::Status SimulateEpisode(const v1::SimulateEpisodeRequest& request, v1::SimulateEpisodeResponse* out,
                               const Cancelled& cancelled);

  UseCases& use_cases_;
};

}  // namespace orbitune
