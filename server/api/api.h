// The API as every transport serves it: all methods, the threads they run on, and the streams that are open.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/access/access.h"
#include "server/api/access_api.h"
#include "server/api/call_log.h"
#include "server/api/call_metrics.h"
#include "server/api/campaigns.h"
#include "server/api/gains.h"
#include "server/api/scenarios.h"
#include "server/api/simulation.h"
#include "server/api/tuning.h"

namespace orbitune {

// Larger than any sensible request, so that an oversized field is refused by name.
inline constexpr int kLargestRequestBytes = 16 << 20;

struct ApiLimits {
  ExecutorLimits calls;
  Feeds::Limits watchers;
  std::int64_t max_waiting_bytes = 256LL << 20;  // of large requests whose calls have not been answered
  std::int64_t max_response_bytes = 64LL << 20;
  double slow_call_s = 1;  // one that takes longer is logged, unless it is meant to
};

// Thread-safe. Outlives the transports.
class Api {
 public:
  // All outlive this. access: nullptr: everybody is a local admin, and no audit log is kept.
  Api(UseCases& use_cases, CampaignUseCases& campaigns, GainUseCases& gains, Access* access = nullptr,
      const ApiLimits& limits = {});
  ~Api();

  const MethodTable& methods() const { return methods_; }

  // Full names of the services that have methods.
  std::vector<std::string> ServiceNames() const;

  // Who calls `method`; errors as Access::Authenticate's.
  absl::StatusOr<Caller> Authenticate(const Credentials& credentials, std::string_view method);

  // nullptr: none.
  Access* access() { return access_; }

  // Answers a unary method on the threads meant for it, and calls `done` there; or calls it at once, with
  // RESOURCE_EXHAUSTED where too many calls wait, or UNAVAILABLE once it is drained. Not run at all for a caller that
  // has gone meanwhile. Counted and logged. request, response: live until then.
  void Call(const Method& method, CallContext context, const google::protobuf::Message& request,
            google::protobuf::Message* response, std::function<void(absl::Status)> done);

  // A stream; one that ends at once with PERMISSION_DENIED where the method's rule keeps the caller out. It ends with
  // UNAUTHENTICATED when the caller's token or session does, and at once with RESOURCE_EXHAUSTED where there are too
  // many.
  std::shared_ptr<Feed> Open(const Method& method, const CallContext& context,
                             const google::protobuf::Message& request);

  // Whether the caller's role lets it call the method at all, whatever the request. A refusal is noted.
  absl::Status CheckRole(const Method& method, const Caller& caller);

  // For what a transport has to do that may block.
  Executors& executors() { return executors_; }

  // Ends every stream with UNAVAILABLE, and every later one at once; likewise calls, and those under way that ask now
  // and then whether they are wanted.
  void Drain();

  const CallMetrics& call_metrics() const { return call_metrics_; }
  Feeds::Counts CountWatchers() { return feeds_.Count(); }

 private:
  struct Pending;

  // Here; may block. PERMISSION_DENIED where the method's rule keeps the caller out. What is changed is in the audit
  // log before it is answered.
  absl::Status Answer(const Method& method, const CallContext& context, const google::protobuf::Message& request,
                      google::protobuf::Message* response);
  absl::Status AnswerWithinLimits(const Pending& call);
  absl::Status HoldBytes(Pending& call);
  void Run(const std::shared_ptr<Pending>& call);
  void Finish(Pending& call, const absl::Status& status);
  void Note(const Method& method, const Caller& caller, const std::string& resource, const absl::Status& outcome);
  absl::Status CheckOwner(const Method& method, const Caller& caller, const google::protobuf::Message& request) const;

  UseCases& use_cases_;
  CampaignUseCases& campaign_use_cases_;
  Access* const access_;
  const ApiLimits limits_;
  std::atomic<bool> draining_ = false;
  std::atomic<std::int64_t> held_bytes_ = 0;
  CallMetrics call_metrics_;
  CallLog call_log_;
  Feeds feeds_;
  JobEventMessages messages_;
  TuningApi tuning_;
  CampaignApi campaigns_;
  GainApi gains_;
  ScenarioApi scenarios_;
  SimulationApi simulation_;
  AccessApi access_api_;
  MethodTable methods_;
  Executors executors_;  // the last: ends before what its tasks use
};

}  // namespace orbitune
