#include "server/api/methods.h"

#include "core/base/check.h"
#include "google/api/annotations.pb.h"
#include "orbitune/v1/access.pb.h"

namespace orbitune {
namespace {

Role FromProto(v1::Role role) {
  switch (role) {
    case v1::ROLE_VIEWER:
      return Role::kViewer;
    case v1::ROLE_OPERATOR:
      return Role::kOperator;
    case v1::ROLE_ADMIN:
      return Role::kAdmin;
    default:
      return Role::kNone;
  }
}

// A method without a rule ends the process: nothing is open because it was forgotten.
AccessRule RuleOf(const google::protobuf::MethodDescriptor& method) {
  const v1::AccessRule& option = method.options().GetExtension(v1::access);
  AccessRule rule{.role = FromProto(option.role())};
  rule.changes = rule.role >= Role::kOperator && !method.options().GetExtension(google::api::http).has_get();
  ORBITUNE_CHECK(rule.role != Role::kNone);
  if (option.owned().empty()) return rule;
  ORBITUNE_CHECK(!method.server_streaming());  // an owner is looked up where that may block
  const std::size_t equals = option.owned().find('=');
  ORBITUNE_CHECK(equals != std::string::npos && option.owned().ends_with("/*"));
  rule.owned = method.input_type()->FindFieldByName(option.owned().substr(0, equals));
  rule.collection = option.owned().substr(equals + 1, option.owned().size() - equals - 3);
  ORBITUNE_CHECK(rule.owned != nullptr && rule.owned->type() == google::protobuf::FieldDescriptor::TYPE_STRING &&
                 !rule.owned->is_repeated() && (rule.collection == "jobs" || rule.collection == "campaigns"));
  return rule;
}

}  // namespace

void MethodTable::Insert(std::string_view name, Method entry) {
  entry.descriptor = google::protobuf::DescriptorPool::generated_pool()->FindMethodByName(std::string(name));
  ORBITUNE_CHECK(entry.descriptor != nullptr);
  ORBITUNE_CHECK(entry.descriptor->input_type() == entry.request->GetDescriptor());
  ORBITUNE_CHECK(entry.descriptor->output_type() == entry.response->GetDescriptor());
  ORBITUNE_CHECK(entry.descriptor->server_streaming() == (entry.open != nullptr));
  entry.access = RuleOf(*entry.descriptor);
  ORBITUNE_CHECK(methods_.emplace(std::string(name), std::move(entry)).second);
}

const Method* MethodTable::Find(std::string_view name) const {
  const auto found = methods_.find(name);
  return found == methods_.end() ? nullptr : &found->second;
}

}  // namespace orbitune
