#include "client/cli/json.h"

#include "google/protobuf/util/json_util.h"
#include "google/protobuf/wrappers.pb.h"

namespace orbitune::cli {
namespace {

std::string ToJson(const google::protobuf::Message& message, bool pretty) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  options.always_print_primitive_fields = true;
  options.add_whitespace = pretty;
  std::string text;
  const auto status = google::protobuf::util::MessageToJsonString(message, &text, options);
  return status.ok() ? text : "{}";
}

}  // namespace

std::string JsonLine(const google::protobuf::Message& message) {
  std::string line = ToJson(message, false);
  line += '\n';
  return line;
}

std::string JsonPretty(const google::protobuf::Message& message) { return ToJson(message, true); }

std::string JsonQuote(const std::string& text) {
  google::protobuf::StringValue value;
  value.set_value(text);
  return ToJson(value, false);
}

}  // namespace orbitune::cli
