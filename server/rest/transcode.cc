#include "server/rest/transcode.h"

#include <optional>
#include <set>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/status.h"
#include "server/api/json.h"
#include "server/rest/text.h"

namespace orbitune::rest {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

// Takes over violations whose fields are the request's already.
void AddAll(const absl::Status& status, FieldErrors& errors) {
  for (FieldViolation& violation : FieldViolationsOf(status)) errors.AddViolation(std::move(violation));
}

absl::Status BadField(std::string_view field, std::string_view allowed, std::string_view received) {
  FieldErrors errors;
  errors.Add(field, allowed, FormatReceived(received));
  return errors.ToStatus();
}

const FieldDescriptor* FindField(const Descriptor* type, std::string_view name) {
  const FieldDescriptor* field = type->FindFieldByName(std::string(name));
  return field != nullptr ? field : type->FindFieldByCamelcaseName(std::string(name));
}

// The message that holds the last field of `path`, and that field; nullptr where there is none.
std::pair<Message*, const FieldDescriptor*> Resolve(Message* message, const std::string& path) {
  const std::vector<std::string_view> names = Split(path, '.');
  for (std::size_t i = 0;; ++i) {
    const FieldDescriptor* field = FindField(message->GetDescriptor(), names[i]);
    if (field == nullptr || i + 1 == names.size()) return {message, field};
    if (field->is_repeated() || field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) return {message, nullptr};
    message = message->GetReflection()->MutableMessage(message, field);
  }
}

// json_util takes yes, t and 1 for true, too.
bool IsNoBool(const FieldDescriptor* field, const std::string& value) {
  return field->cpp_type() == FieldDescriptor::CPPTYPE_BOOL && value != "true" && value != "false";
}

std::string_view Kind(const FieldDescriptor* field) {
  switch (field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_BOOL:
      return "true or false";
    case FieldDescriptor::CPPTYPE_DOUBLE:
    case FieldDescriptor::CPPTYPE_FLOAT:
      return "a number";
    case FieldDescriptor::CPPTYPE_STRING:
      return "text";
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return "a value of its type";
    case FieldDescriptor::CPPTYPE_ENUM:
      return "one of its names";
    case FieldDescriptor::CPPTYPE_INT32:
      return "an integer in [-2147483648, 2147483647]";
    case FieldDescriptor::CPPTYPE_UINT32:
      return "an integer in [0, 4294967295]";
    case FieldDescriptor::CPPTYPE_INT64:
      return "an integer in [-9223372036854775808, 9223372036854775807]";
    case FieldDescriptor::CPPTYPE_UINT64:
      return "an integer in [0, 18446744073709551615]";
  }
  return "";
}

// Messages with a text form of their own (Timestamp, Duration, wrappers, FieldMask) are values, others are not.
bool HasTextForm(const FieldDescriptor* field) {
  return field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE ||
         (field->message_type()->file()->package() == "google.protobuf" && !field->is_map());
}

// "(hyperparameters.iterations): invalid value "x" ..." names a field; what does not is about the body as a whole.
FieldViolation ViolationOf(std::string_view message, const std::string& body_field) {
  std::string field = body_field;
  const std::size_t end = message.find("): ");
  if (message.starts_with('(') && end != message.npos) {
    absl::StrAppend(&field, field.empty() ? "" : ".", ToAbsl(message.substr(1, end - 1)));
    message.remove_prefix(end + 3);
  } else if (message.starts_with(": ")) {
    message.remove_prefix(2);
  }
  if (field.empty()) field = "body";
  // The first line tells; the others point into the text.
  std::string description(message.substr(0, message.find('\n')));
  for (char& c : description) c = static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? '?' : c;
  return {std::move(field), std::move(description)};
}

absl::Status ReadBody(const Route& route, const std::string& body, Message* message) {
  if (route.body.empty()) return body.empty() ? absl::OkStatus() : BadField("body", "empty", body);
  const bool whole = route.body == "*";
  if (body.empty() && whole) return absl::OkStatus();
  Message* into = message;
  if (!whole) {
    const auto [holder, field] = Resolve(message, route.body);
    ORBITUNE_CHECK(field != nullptr);
    into = holder->GetReflection()->MutableMessage(holder, field);
  }
  const absl::Status status = FromJson(body.empty() ? "{}" : body, into);
  if (status.ok()) return status;
  FieldErrors errors;
  errors.AddViolation(ViolationOf(std::string(status.message()), whole ? "" : route.body));
  return errors.ToStatus();
}

// Whether a parameter may set the field: the path and the body have theirs already.
bool IsTaken(const Route& route, const std::string& path) {
  const std::string name(Split(path, '.')[0]);
  if (route.body == "*" || (!route.body.empty() && route.body == name)) return true;
  for (const PathTemplate::Variable& variable : route.path.variables) {
    if (variable.field == path) return true;
  }
  return false;
}

}  // namespace

absl::Status SetField(Message* message, const std::string& path, const std::string& value) {
  const auto [holder, field] = Resolve(message, path);
  if (field != nullptr && IsNoBool(field, value)) return BadField(path, Kind(field), value);
  if (field == nullptr || !HasTextForm(field)) return BadField(path, "a field of the request that text can set", value);
  // JSON knows every type; a repeated field goes in as a list of one, which is appended.
  const std::unique_ptr<Message> parsed(holder->New());
  const std::string json = QuoteJson(value);  // of numbers, too
  const std::string document =
      absl::StrCat("{", QuoteJson(field->name()), ":", field->is_repeated() ? absl::StrCat("[", json, "]") : json, "}");
  const absl::Status status = FromJson(document, parsed.get());
  const Reflection* reflection = parsed->GetReflection();
  if (!status.ok() || (field->has_presence() && !reflection->HasField(*parsed, field))) {
    return BadField(path, Kind(field), value);
  }
  if (field->has_presence() || field->is_repeated()) {
    holder->MergeFrom(*parsed);
  } else {
    reflection->SwapFields(holder, parsed.get(), {field});  // a default value, too
  }
  return absl::OkStatus();
}

absl::Status ReadRequest(const Route& route, const std::vector<Binding>& bindings, const std::vector<Query>& query,
                         const std::string& body, Message* message) {
  FieldErrors errors;
  AddAll(ReadBody(route, body, message), errors);
  std::set<std::string> seen;
  for (const Query& parameter : query) {
    if (IsTaken(route, parameter.name)) {
      errors.Add(parameter.name, "left out of the query: the path or the body has it", FormatReceived(parameter.value));
      continue;
    }
    const auto [holder, field] = Resolve(message, parameter.name);
    if (field != nullptr && !field->is_repeated() && !seen.insert(parameter.name).second) {
      errors.Add(parameter.name, "given once", FormatReceived(parameter.value));
      continue;
    }
    AddAll(SetField(message, parameter.name, parameter.value), errors);
  }
  for (const Binding& binding : bindings) AddAll(SetField(message, binding.field, binding.value), errors);
  return errors.ToStatus();
}

}  // namespace orbitune::rest
