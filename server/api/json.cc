#include "server/api/json.h"

#include "core/base/check.h"
#include "core/base/status.h"
#include "google/protobuf/util/json_util.h"

namespace orbitune {

std::string ToJson(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  options.always_print_primitive_fields = true;
  std::string json;
  const auto status = google::protobuf::util::MessageToJsonString(message, &json, options);
  ORBITUNE_CHECK(status.ok());
  return json;
}

absl::Status FromJson(const std::string& json, google::protobuf::Message* message) {
  const auto status = google::protobuf::util::JsonStringToMessage(json, message);
  if (status.ok()) return absl::OkStatus();
  return absl::InvalidArgumentError(ToAbsl(std::string(status.message())));
}

}  // namespace orbitune
