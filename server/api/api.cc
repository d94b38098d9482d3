#include "server/api/api.h"

#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status.h"
#include "server/convert/orbit.h"

namespace orbitune {

Api::Api(UseCases& use_cases, CampaignUseCases& campaigns, GainUseCases& gains)
    : use_cases_(use_cases),
      campaign_use_cases_(campaigns),
      tuning_({use_cases, executors_, messages_, feeds_}),
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

absl::Status Api::CheckRole(const Method& method, const Caller& caller) {
  if (caller.role >= method.access.role) return absl::OkStatus();
  return WithReason(absl::PermissionDeniedError(
                        absl::StrCat(method.descriptor->name(), ": needs the role ", ToAbsl(NameOf(method.access.role)),
                                     ", ", FormatReceived(caller.name), " is ", ToAbsl(NameOf(caller.role)))),
                    "ROLE_REQUIRED");
}

// What there is not is said to all: names are no secret, and every role may read.
absl::Status Api::CheckOwner(const Method& method, const Caller& caller,
                             const google::protobuf::Message& request) const {
  const AccessRule& rule = method.access;
  if (rule.owned == nullptr || caller.role == Role::kAdmin) return absl::OkStatus();
  const std::string name = request.GetReflection()->GetString(request, rule.owned);
  const auto id = IdFromName(rule.collection, name, rule.owned->name());
  if (!id.ok()) return id.status();
  const auto owner_of = [](const auto& record) { return record.ok() ? record->spec.owner : std::string(); };
  absl::Status found;
  std::string owner;
  if (rule.collection == "jobs") {
    const auto job = use_cases_.GetJob(*id);
    found = job.status(), owner = owner_of(job);
  } else {
    const auto campaign = campaign_use_cases_.Get(*id);
    found = campaign.status(), owner = owner_of(campaign);
  }
  if (!found.ok()) return found;
  if (!owner.empty() && owner == caller.owner()) return absl::OkStatus();
  return WithReason(
      absl::PermissionDeniedError(absl::StrCat(method.descriptor->name(), ": ", name, " is ",
                                               owner.empty() ? "nobody's" : FormatReceived(owner) + "'s", ", not ",
                                               FormatReceived(caller.name), "'s: needs its owner or the role admin")),
      "OWNER_REQUIRED");
}

absl::Status Api::Answer(const Method& method, const CallContext& context, const google::protobuf::Message& request,
                         google::protobuf::Message* response) {
  absl::Status status = CheckRole(method, context.caller);
  if (status.ok()) status = CheckOwner(method, context.caller, request);
  if (status.ok()) status = method.answer(request, response, context);
  return status;
}

void Api::Call(const Method& method, CallContext context, const google::protobuf::Message& request,
               google::protobuf::Message* response, std::function<void(absl::Status)> done) {
  if (absl::Status status = CheckRole(method, context.caller); !status.ok()) return done(status);
  const Work work = method.work_of ? method.work_of(request) : method.work;
  const bool posted = executors_.For(work).TryPost([this, &method, context = std::move(context), &request, response,
                                                    done] { done(Answer(method, context, request, response)); });
  if (!posted) done(absl::ResourceExhaustedError("too many requests are waiting"));
}

std::shared_ptr<Feed> Api::Open(const Method& method, const CallContext& context,
                                const google::protobuf::Message& request) {
  absl::Status status = CheckRole(method, context.caller);
  return status.ok() ? method.open(request, context) : EndedFeed(std::move(status));
}

}  // namespace orbitune
