// `orbitune scenarios [NAME]`.
#include "client/cli/commands.h"
#include "client/cli/errors.h"
#include "client/cli/fields.h"
#include "client/cli/format.h"
#include "client/cli/json.h"
#include "client/cli/parse.h"
#include "client/cli/session.h"
#include "client/cli/table.h"

namespace orbitune::cli {
namespace {

int ShowScenario(Session& session, const std::string& name) {
  v1::GetScenarioRequest request;
  request.set_name(ResourceName("scenarios", name));
  v1::Scenario scenario;
  const grpc::Status status = session.Call(&v1::ScenarioService::Stub::GetScenario, request, &scenario);
  if (!status.ok()) return session.Fail(status);
  if (session.json()) {
    session.out() << JsonPretty(scenario);
  } else {
    PrintFields(scenario, 0, session.out());
  }
  return kExitOk;
}

}  // namespace

int RunScenarios(Session& session, const ScenariosOptions& options) {
  if (!options.name.empty()) return ShowScenario(session, options.name);
  Table table({"NAME", ">TS_S", ">HORIZON", ">RHO", ">EPSILON_KM", ">ITERATIONS", ">DIRECTIONS", "TITLE"});
  v1::ListScenariosRequest request;
  v1::ListScenariosResponse response;
  do {
    const grpc::Status status = session.Call(&v1::ScenarioService::Stub::ListScenarios, request, &response);
    if (!status.ok()) return session.Fail(status);
    for (const v1::Scenario& scenario : response.scenarios()) {
      if (session.json()) {
        session.out() << JsonLine(scenario);
        continue;
      }
      table.AddRow({scenario.name(), Human(scenario.sampling_period_s()), std::to_string(scenario.horizon_samples()),
                    Human(scenario.fuel_weight()), Human(scenario.settling_distance_km()),
                    std::to_string(scenario.hyperparameters().iterations()),
                    std::to_string(scenario.hyperparameters().directions()), Printable(scenario.display_name())});
    }
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  if (!session.json()) table.Print(session.out());
  return kExitOk;
}

}  // namespace orbitune::cli
