#include "server/api/scenarios.h"

#include "server/api/answer.h"
#include "server/convert/orbit.h"

namespace orbitune {

void ScenarioApi::AddTo(MethodTable& methods) {
  const std::string service = "orbitune.v1.ScenarioService.";
  methods.Add(service + "ListScenarios", Work::kRead, this, &ScenarioApi::ListScenarios);
  methods.Add(service + "GetScenario", Work::kRead, this, &ScenarioApi::GetScenario);
}

absl::Status ScenarioApi::ListScenarios(const v1::ListScenariosRequest& request, v1::ListScenariosResponse* out) {
  const auto page = use_cases_.ListScenarios(request.page_size(), request.page_token());
  return AnswerPage(page, out, [out] { return out->add_scenarios(); });
}

absl::Status ScenarioApi::GetScenario(const v1::GetScenarioRequest& request, v1::Scenario* out) {
  const auto id = IdFromName("scenarios", request.name(), "name");
  return id.ok() ? Answer(use_cases_.GetScenario(*id), out) : id.status();
}

}  // namespace orbitune
