#include "server/api/json.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/status.h"
#include "google/protobuf/util/json_util.h"

namespace orbitune {
namespace {

using google::protobuf::EnumValueDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

// Writes what events are made of, numbers and plain texts, in the very bytes of protobuf's own JSON, which takes ten
// times as long. Anything else (well-known types, maps, texts to escape) it leaves to that.
class QuickJson {
 public:
  explicit QuickJson(std::string& out) : out_(out) {}

  // False: not of this kind; what was written is to be thrown away.
  bool Append(const Message& message) {
    if (message.GetDescriptor()->file()->package() == "google.protobuf") return false;
    const Reflection& reflection = *message.GetReflection();
    char separator = '{';
    for (const FieldDescriptor* field : Fields(message, reflection)) {
      out_ += separator;
      separator = ',';
      out_ += '"';
      out_ += field->name();
      out_ += "\":";
      if (!(field->is_repeated() ? AppendAll(message, reflection, field) : AppendOne(message, reflection, field))) {
        return false;
      }
    }
    if (separator == '{') out_ += '{';
    out_ += '}';
    return true;
  }

 private:
  // As declared; then those that may be unset and are not, by their numbers.
  static std::vector<const FieldDescriptor*> Fields(const Message& message, const Reflection& reflection) {
    std::vector<const FieldDescriptor*> fields;
    for (int i = 0; i < message.GetDescriptor()->field_count(); ++i) {
      const FieldDescriptor* field = message.GetDescriptor()->field(i);
      const bool unset = field->has_presence() && !reflection.HasField(message, field);
      if (field->containing_oneof() == nullptr && !unset) fields.push_back(field);
    }
    std::vector<const FieldDescriptor*> set;
    reflection.ListFields(message, &set);
    std::ranges::copy_if(set, std::back_inserter(fields),
                         [](auto* field) { return field->containing_oneof() != nullptr; });
    return fields;
  }

  bool AppendAll(const Message& message, const Reflection& reflection, const FieldDescriptor* field) {
    if (field->is_map() || field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) {
      if (field->is_map() || reflection.FieldSize(message, field) > 0) return false;
    }
    out_ += '[';
    for (int i = 0; i < reflection.FieldSize(message, field); ++i) {
      if (i > 0) out_ += ',';
      if (!Append(reflection.GetRepeatedMessage(message, field, i))) return false;
    }
    out_ += ']';
    return true;
  }

  bool AppendOne(const Message& message, const Reflection& reflection, const FieldDescriptor* field) {
    switch (field->cpp_type()) {
      case FieldDescriptor::CPPTYPE_BOOL:
        out_ += reflection.GetBool(message, field) ? "true" : "false";
        return true;
      case FieldDescriptor::CPPTYPE_INT32:
        absl::StrAppend(&out_, reflection.GetInt32(message, field));
        return true;
      case FieldDescriptor::CPPTYPE_INT64:
        absl::StrAppend(&out_, "\"", reflection.GetInt64(message, field), "\"");
        return true;
      case FieldDescriptor::CPPTYPE_DOUBLE:
        return AppendNumber(reflection.GetDouble(message, field));
      case FieldDescriptor::CPPTYPE_ENUM: {
        const EnumValueDescriptor* value =
            field->enum_type()->FindValueByNumber(reflection.GetEnumValue(message, field));
        return value != nullptr && AppendPlain(value->name());
      }
      case FieldDescriptor::CPPTYPE_STRING: {
        std::string scratch;
        return field->type() == FieldDescriptor::TYPE_STRING &&
               AppendPlain(reflection.GetStringReference(message, field, &scratch));
      }
      case FieldDescriptor::CPPTYPE_MESSAGE:
        return Append(reflection.GetMessage(message, field));
      default:
        return false;
    }
  }

  // As "%.15g" has it, or where that is another number "%.17g".
  bool AppendNumber(double value) {
    if (!std::isfinite(value)) return false;
    char text[32];
    auto end = std::to_chars(text, text + sizeof text, value, std::chars_format::general, 15);
    double read = 0;
    std::from_chars(text, end.ptr, read);
    if (read != value) end = std::to_chars(text, text + sizeof text, value, std::chars_format::general, 17);
    out_.append(text, end.ptr);
    return true;
  }

  bool AppendPlain(const std::string& text) {
    const auto plain = [](char c) { return c >= ' ' && c <= '~' && c != '"' && c != '\\' && c != '<' && c != '>'; };
    if (!std::ranges::all_of(text, plain)) return false;
    absl::StrAppend(&out_, "\"", text, "\"");
    return true;
  }

  std::string& out_;
};

}  // namespace

std::string ToJson(const google::protobuf::Message& message) {
  std::string quick;
  return QuickJson(quick).Append(message) ? quick : ToJsonByProtobuf(message);
}

std::string ToJsonByProtobuf(const google::protobuf::Message& message) {
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

std::string QuoteJson(std::string_view text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (static_cast<unsigned char>(c) < 0x20) {
      absl::StrAppend(&quoted, "\\u00", absl::Hex(static_cast<unsigned char>(c), absl::kZeroPad2));
    } else {
      if (c == '"' || c == '\\') quoted += '\\';
      quoted += c;
    }
  }
  return quoted += '"';
}

}  // namespace orbitune
