// The API as every transport serves it: all methods, the threads they run on, and the streams that are open.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/api/campaigns.h"
#include "server/api/gains.h"
#include "server/api/scenarios.h"
#include "server/api/simulation.h"
#include "server/api/tuning.h"

namespace orbitune {

// Larger than any sensible request, so that an oversized field is refused by name.
inline constexpr int kLargestRequestBytes = 16 << 20;

// Thread-safe. Outlives the transports.
class Api {
 public:
  // Both outlive this.
  Api(UseCases& use_cases, CampaignUseCases& campaigns, GainUseCases& gains);

  const MethodTable& methods() const { return methods_; }

  // Full names of the services that have methods.
  std::vector<std::string> ServiceNames() const;

  // Answers a unary method on the threads meant for it, and calls `done` there; or calls it at once, with
  // RESOURCE_EXHAUSTED, where too many calls wait. request, response: live until then.
  void Call(const Method& method, CallContext context, const google::protobuf::Message& request,
            google::protobuf::Message* response, std::function<void(absl::Status)> done);

  // Answers a unary method here; may block. PERMISSION_DENIED where the method's rule keeps the caller out.
  absl::Status Answer(const Method& method, const CallContext& context, const google::protobuf::Message& request,
                      google::protobuf::Message* response);

  // A stream; one that ends at once with PERMISSION_DENIED where the method's rule keeps the caller out.
  std::shared_ptr<Feed> Open(const Method& method, const CallContext& context,
                             const google::protobuf::Message& request);

  // Whether the caller's role lets it call the method at all, whatever the request.
  static absl::Status CheckRole(const Method& method, const Caller& caller);

  // For what a transport has to do that may block.
  Executors& executors() { return executors_; }

  // Ends every stream with UNAVAILABLE, and every later one at once.
  void Drain() { feeds_.Drain(); }

 private:
  absl::Status CheckOwner(const Method& method, const Caller& caller, const google::protobuf::Message& request) const;

  UseCases& use_cases_;
  CampaignUseCases& campaign_use_cases_;
  Feeds feeds_;
  JobEventMessages messages_;
  TuningApi tuning_;
  CampaignApi campaigns_;
  GainApi gains_;
  ScenarioApi scenarios_;
  SimulationApi simulation_;
  MethodTable methods_;
  Executors executors_;  // the last: ends before what its tasks use
};

}  // namespace orbitune
