#include "server/api/api.h"

#include <chrono>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status.h"
#include "server/convert/orbit.h"
#include "server/jobs/limit.h"

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

// A unary call until it is answered.
struct Api::Pending {
  const Method& method;
  const CallContext context;
  const google::protobuf::Message& request;
  google::protobuf::Message* const response;
  const std::function<void(absl::Status)> done;
  const std::chrono::steady_clock::time_point begun = std::chrono::steady_clock::now();
  std::int64_t held_bytes = 0;
};

Api::Api(UseCases& use_cases, CampaignUseCases& campaigns, GainUseCases& gains, Access* access, const ApiLimits& limits)
    : use_cases_(use_cases),
      campaign_use_cases_(campaigns),
      access_(access),
      limits_(limits),
      call_log_(limits.slow_call_s),
      feeds_(limits.watchers),
      tuning_({use_cases, executors_, messages_, feeds_}),
      campaigns_({campaigns, executors_, feeds_}),
      gains_(gains),
      scenarios_(use_cases),
      simulation_(use_cases),
      access_api_(access),
      executors_(limits.calls) {
  tuning_.AddTo(methods_);
  campaigns_.AddTo(methods_);
  gains_.AddTo(methods_);
  scenarios_.AddTo(methods_);
  simulation_.AddTo(methods_);
  access_api_.AddTo(methods_);
  if (access_ == nullptr) return;
  access_->OnCredentialEnd(
      [this](const std::string& credential_id, const absl::Status& why) { feeds_.EndThoseOf(credential_id, why); });
}

Api::~Api() {
  if (access_ != nullptr) access_->OnCredentialEnd(nullptr);
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
  context.cancelled = [this, asked = std::move(context.cancelled)] { return draining_ || asked(); };
  const auto call = std::make_shared<Pending>(Pending{.method = method,
                                                      .context = std::move(context),
                                                      .request = request,
                                                      .response = response,
                                                      .done = std::move(done)});
  absl::Status status = draining_ ? GoingDown() : CheckRole(method, call->context.caller);
  if (status.ok()) status = HoldBytes(*call);
  const Work work = method.work_of ? method.work_of(request) : method.work;
  if (status.ok()) status = executors_.For(work).TryPost(call->context.caller.client(), [this, call] { Run(call); });
  if (!status.ok()) Finish(*call, status);
}

// Many small requests are bounded by their number.
absl::Status Api::HoldBytes(Pending& call) {
  constexpr std::int64_t kSmall = 64 << 10;
  const auto bytes = static_cast<std::int64_t>(call.request.ByteSizeLong());
  if (bytes <= kSmall) return absl::OkStatus();
  if ((held_bytes_ += bytes) > limits_.max_waiting_bytes) {
    held_bytes_ -= bytes;
    return LimitExceeded("MiB of large requests at once", {"max-waiting-mib", limits_.max_waiting_bytes >> 20},
                         "try again when some have been answered");
  }
  call.held_bytes = bytes;
  return absl::OkStatus();
}

void Api::Run(const std::shared_ptr<Pending>& call) {
  absl::Status status;
  if (draining_) {
    status = GoingDown();
  } else if (call->context.cancelled()) {
    status = absl::CancelledError("the caller has gone, or its deadline has passed, while the call waited");
  } else {
    status = AnswerWithinLimits(*call);
    if (draining_ && absl::IsCancelled(status)) status = GoingDown();
  }
  Finish(*call, status);
}

absl::Status Api::AnswerWithinLimits(const Pending& call) {
  absl::Status status = Answer(call.method, call.context, call.request, call.response);
  if (!status.ok()) return status;
  const auto bytes = static_cast<std::int64_t>(call.response->ByteSizeLong());
  if (bytes <= limits_.max_response_bytes) return status;
  call.response->Clear();
  return LimitExceeded(absl::StrCat("an answer of ", bytes, " bytes"),
                       {"max-response-bytes", limits_.max_response_bytes},
                       "ask for less at a time: page_size, max_points, sample_stride");
}

void Api::Finish(Pending& call, const absl::Status& status) {
  held_bytes_ -= std::exchange(call.held_bytes, 0);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - call.begun).count();
  call_metrics_.Observe(call.method.descriptor, status.code(), seconds);
  call_log_.Note(call.method, call.context.caller, ResourceOf(call.request, *call.response), status, seconds);
  call.done(status);
}

std::shared_ptr<Feed> Api::Open(const Method& method, const CallContext& context,
                                const google::protobuf::Message& request) {
  const Caller& caller = context.caller;
  const auto refuse = [&](absl::Status status) {
    call_metrics_.Observe(method.descriptor, status.code(), 0);
    call_log_.Note(method, caller, ResourceOf(request, *method.response), status, 0);
    return EndedFeed(std::move(status));
  };
  if (absl::Status status = CheckRole(method, caller); !status.ok()) return refuse(std::move(status));
  auto feed = feeds_.Open({caller.client(), caller.credential_id(), context.transport},
                          [&] { return method.open(request, context); });
  if (!feed.ok()) return refuse(feed.status());
  if (caller.token_id.empty() || access_ == nullptr) return *std::move(feed);
  if (absl::Status status = access_->StillValid(caller); !status.ok()) (*feed)->End(status);
  return *std::move(feed);
}

void Api::Drain() {
  draining_ = true;
  feeds_.Drain();
}

}  // namespace orbitune
