#include "server/api/methods.h"

#include "core/base/check.h"

namespace orbitune {

void MethodTable::Insert(std::string_view name, Method entry) {
  entry.descriptor = google::protobuf::DescriptorPool::generated_pool()->FindMethodByName(std::string(name));
  ORBITUNE_CHECK(entry.descriptor != nullptr);
  ORBITUNE_CHECK(entry.descriptor->input_type() == entry.request->GetDescriptor());
  ORBITUNE_CHECK(entry.descriptor->output_type() == entry.response->GetDescriptor());
  ORBITUNE_CHECK(entry.descriptor->server_streaming() == (entry.open != nullptr));
  ORBITUNE_CHECK(methods_.emplace(std::string(name), std::move(entry)).second);
}

const Method* MethodTable::Find(std::string_view name) const {
  const auto found = methods_.find(name);
  return found == methods_.end() ? nullptr : &found->second;
}

}  // namespace orbitune
