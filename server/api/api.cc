#include "server/api/api.h"

#include <set>
#include <utility>

namespace orbitune {

Api::Api(UseCases& use_cases, CampaignUseCases& campaigns, GainUseCases& gains)
    : tuning_({use_cases, executors_, messages_, feeds_}),
      campaigns_({campaigns, executors_, feeds_}),
      gains_(gains),
      scenarios_(use_cases),
      simulation_(use_cases) {
  tuning_.AddTo(methods_);
  campaigns_.AddTo(methods_);
  gains_.AddTo(methods_);
  scenarios_.AddTo(methods_);
  simulation_.AddTo(methods_);
}

std::vector<std::string> Api::ServiceNames() const {
  std::set<std::string> names;
  for (const auto& [name, method] : methods_.all()) names.insert(method.descriptor->service()->full_name());
  return {names.begin(), names.end()};
}

void Api::Call(const Method& method, const google::protobuf::Message& request, google::protobuf::Message* response,
               Cancelled cancelled, std::function<void(absl::Status)> done) {
  const Work work = method.work_of ? method.work_of(request) : method.work;
  const bool posted = executors_.For(work).TryPost(
      [&method, &request, response, cancelled, done] { done(method.answer(request, response, cancelled)); });
  if (!posted) done(absl::ResourceExhaustedError("too many requests are waiting"));
}

}  // namespace orbitune
