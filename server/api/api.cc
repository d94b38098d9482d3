#include "server/api/api.h"

#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status.h"
#include "server/convert/orbit.h"

namespace orbitune {

namespace {

// The text of a field, if the message has it.
std::string TextOf(const google::protobuf::Message& message, const char* name) {
  const auto* field = message.GetDescriptor()->FindFieldByName(name);
  const bool is_text = field != nullptr && field->type() == google::protobuf::FieldDescriptor::TYPE_STRING;
  return is_text && !field->is_repeated() ? message.GetReflection()->GetString(message, field) : "";
}

bool OnlyValidates(const google::protobuf::Message& request) {
  const auto* field = request.GetDescriptor()->FindFieldByName("validate_only");
  return field != nullptr && request.GetReflection()->GetBool(request, field);
}

// What a call is about: what its request names, else what it has made.
std::string ResourceOf(const google::protobuf::Message& request, const google::protobuf::Message& response) {
  for (const std::string& name : {TextOf(request, "name"), TextOf(request, "parent"), TextOf(response, "name")}) {
    if (!name.empty()) return name;
  }
  return "";
}

}  // namespace

Api::Api(UseCases& use_cases, CampaignUseCases& campaigns, GainUseCases& gains, Access* access)
    : use_cases_(use_cases),
      campaign_use_cases_(campaigns),
      access_(access),
      tuning_({use_cases, executors_, messages_, feeds_}),
      campaigns_({campaigns, executors_, feeds_}),
      gains_(gains),
      scenarios_(use_cases),
      simulation_(use_cases),
      access_api_(access) {
  tuning_.AddTo(methods_);
  campaigns_.AddTo(methods_);
  gains_.AddTo(methods_);
  scenarios_.AddTo(methods_);
  simulation_.AddTo(methods_);
  access_api_.AddTo(methods_);
  if (access_ == nullptr) return;
  access_->OnTokenEnd([this](const std::string& token_id) {
    feeds_.EndThoseOf(token_id, absl::UnauthenticatedError("the token is valid no more"));
  });
}

Api::~Api() {
  if (access_ != nullptr) access_->OnTokenEnd(nullptr);
}

absl::StatusOr<Caller> Api::Authenticate(const Credentials& credentials, std::string_view method) {
  if (access_ == nullptr) return LocalCaller(credentials.peer);
  return access_->Authenticate(credentials, method);
}

std::vector<std::string> Api::ServiceNames() const {
  std::set<std::string> names;
  for (const auto& [name, method] : methods_.all()) names.insert(method.descriptor->service()->full_name());
  return {names.begin(), names.end()};
}

absl::Status Api::CheckRole(const Method& method, const Caller& caller) {
  if (caller.role >= method.access.role) return absl::OkStatus();
  absl::Status refusal =
      WithReason(absl::PermissionDeniedError(
                     absl::StrCat(method.descriptor->name(), ": needs the role ", ToAbsl(NameOf(method.access.role)),
                                  ", ", FormatReceived(caller.name), " is ", ToAbsl(NameOf(caller.role)))),
                 "ROLE_REQUIRED");
  if (access_ != nullptr) access_->AuditRefusal(caller, method.descriptor->full_name(), "", refusal);
  return refusal;
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
  if (!status.ok()) return status;
  const bool noted = access_ != nullptr && method.access.changes && !OnlyValidates(request);
  if (noted) status = access_->AuditReady();
  if (status.ok()) status = CheckOwner(method, context.caller, request);
  if (status.ok()) status = method.answer(request, response, context);
  if (noted) Note(method, context.caller, ResourceOf(request, *response), status);
  return status;
}

// After the change is committed, before it is answered.
void Api::Note(const Method& method, const Caller& caller, const std::string& resource, const absl::Status& outcome) {
  const std::string& name = method.descriptor->full_name();
  outcome.ok() ? access_->Audit(caller, name, resource) : access_->AuditRefusal(caller, name, resource, outcome);
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
  if (absl::Status status = CheckRole(method, context.caller); !status.ok()) return EndedFeed(std::move(status));
  auto feed = method.open(request, context);
  if (context.caller.token_id.empty() || access_ == nullptr) return feed;
  feeds_.SetTokenOf(feed.get(), context.caller.token_id);
  if (!access_->StillValid(context.caller)) feed->End(absl::UnauthenticatedError("the token is valid no more"));
  return feed;
}

}  // namespace orbitune
