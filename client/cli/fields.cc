#include "client/cli/fields.h"

#include <string>

#include "absl/strings/str_format.h"
#include "client/cli/format.h"
#include "google/protobuf/descriptor.h"
#include "orbitune/v1/orbit.pb.h"

namespace orbitune::cli {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

std::string ScalarText(const Message& message, const FieldDescriptor& field) {
  const google::protobuf::Reflection& get = *message.GetReflection();
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return Human(get.GetDouble(message, &field), 10);
    case FieldDescriptor::CPPTYPE_INT32:
      return std::to_string(get.GetInt32(message, &field));
    case FieldDescriptor::CPPTYPE_INT64:
      return std::to_string(get.GetInt64(message, &field));
    case FieldDescriptor::CPPTYPE_BOOL:
      return get.GetBool(message, &field) ? "true" : "false";
    case FieldDescriptor::CPPTYPE_UINT64:
      return std::to_string(get.GetUInt64(message, &field));
    case FieldDescriptor::CPPTYPE_ENUM:
      return get.GetEnum(message, &field)->name();
    case FieldDescriptor::CPPTYPE_STRING:
      return Printable(get.GetString(message, &field));
    default:
      return "";
  }
}

}  // namespace

void PrintFields(const Message& message, int indent, std::ostream& out) {
  const google::protobuf::Descriptor& descriptor = *message.GetDescriptor();
  for (int i = 0; i < descriptor.field_count(); ++i) {
    const FieldDescriptor& field = *descriptor.field(i);
    if (field.is_repeated() || (field.has_presence() && !message.GetReflection()->HasField(message, &field))) continue;
    std::string text;
    if (field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      const Message& inner = message.GetReflection()->GetMessage(message, &field);
      if (inner.GetDescriptor() != v1::Gains::descriptor()) {
        out << absl::StrFormat("%*s%s\n", indent, "", field.name());
        PrintFields(inner, indent + 2, out);
        continue;
      }
      text = GainsText(static_cast<const v1::Gains&>(inner), 6);
    } else {
      text = ScalarText(message, field);
    }
    if (!text.empty()) out << absl::StrFormat("%*s%-*s %s\n", indent, "", 32 - indent, field.name(), text);
  }
}

}  // namespace orbitune::cli
