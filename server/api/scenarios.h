// ScenarioService in protobuf, without a transport.
#pragma once

#include "orbitune/v1/scenario.pb.h"
#include "server/api/methods.h"
#include "server/service/use_cases.h"

namespace orbitune {

// Thread-safe.
class ScenarioApi {
 public:
  explicit ScenarioApi(UseCases& use_cases) : use_cases_(use_cases) {}

  void AddTo(MethodTable& methods);

 private:
  absl::Status ListScenarios(const v1::ListScenariosRequest& request, v1::ListScenariosResponse* out);
  absl::Status GetScenario(const v1::GetScenarioRequest& request, v1::Scenario* out);

  UseCases& use_cases_;
};

}  // namespace orbitune
