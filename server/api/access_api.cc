#include "server/api/access_api.h"

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "google/protobuf/util/time_util.h"
#include "server/convert/job.h"
#include "server/service/page_token.h"

namespace orbitune {
namespace {

using google::protobuf::util::TimeUtil;

void ToProto(const AuditEntry& entry, v1::AuditEntry* out) {
  out->set_number(entry.number);
  SetTime(entry.time_us, out->mutable_time());
  out->set_caller(entry.caller);
  out->set_role(entry.role);
  out->set_token_id(entry.token_id);
  out->set_peer(entry.peer);
  out->set_method(entry.method);
  out->set_resource(entry.resource);
  out->set_outcome(entry.outcome);
  out->set_request_id(entry.request_id);
  out->set_count(entry.count);
}

}  // namespace

v1::Role ToProto(Role role) {
  switch (role) {
    case Role::kViewer:
      return v1::ROLE_VIEWER;
    case Role::kOperator:
      return v1::ROLE_OPERATOR;
    case Role::kAdmin:
      return v1::ROLE_ADMIN;
    case Role::kNone:
      break;
  }
  return v1::ROLE_UNSPECIFIED;
}

void AccessApi::AddTo(MethodTable& methods) {
  const std::string service = "orbitune.v1.AccessService.";
  methods.Add(service + "GetCaller", Work::kRead, this, &AccessApi::GetCaller);
  methods.Add(service + "ListAuditEntries", Work::kRead, this, &AccessApi::ListAuditEntries);
}

absl::Status AccessApi::GetCaller(const v1::GetCallerRequest&, v1::Caller* out, const CallContext& context) {
  out->set_name(context.caller.name);
  out->set_role(ToProto(context.caller.role));
  out->set_has_token(!context.caller.token_id.empty());
  return absl::OkStatus();
}

absl::Status AccessApi::ListAuditEntries(const v1::ListAuditEntriesRequest& request,
                                         v1::ListAuditEntriesResponse* out) {
  if (access_ == nullptr) return absl::FailedPreconditionError("this server keeps no audit log");
  const auto size = PageSize(request.page_size(), 100, 1000);
  if (!size.ok()) return size.status();
  AuditQuery query{.limit = *size + 1};  // the one beyond tells whether there is a next page
  if (request.has_since()) query.since_us = TimeUtil::TimestampToMicroseconds(request.since());
  if (request.has_until()) query.until_us = TimeUtil::TimestampToMicroseconds(request.until());
  const std::string list = absl::StrCat("audit\n", query.since_us, "\n", query.until_us);
  if (!request.page_token().empty()) {
    const auto parts = ReadPageToken(request.page_token(), list, 1);
    if (!parts.ok()) return parts.status();
    (void)absl::SimpleAtoi(parts->at(0), &query.after_number);
  }
  auto entries = access_->ListAudit(query);
  if (!entries.ok()) return entries.status();
  if (entries->size() > static_cast<std::size_t>(*size)) {
    entries->pop_back();
    out->set_next_page_token(MakePageToken(list, {absl::StrCat(entries->back().number)}));
  }
  for (const AuditEntry& entry : *entries) ToProto(entry, out->add_entries());
  return absl::OkStatus();
}

}  // namespace orbitune
