#include "client/cli/initial_condition.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/cli/files.h"
#include "client/cli/number.h"
#include "client/cli/parse.h"
#include "google/protobuf/descriptor.h"
#include "google/protobuf/message.h"

namespace orbitune::cli {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using Values = std::vector<std::pair<std::string, double>>;

std::string AllowedKeys(const Descriptor& form) {
  std::string keys;
  for (int i = 0; i < form.field_count(); ++i) {
    const bool alternative = i > 0 && form.field(i)->containing_oneof() != nullptr &&
                             form.field(i)->containing_oneof() == form.field(i - 1)->containing_oneof();
    absl::StrAppend(&keys, i == 0 ? "" : (alternative ? "|" : ", "), form.field(i)->name());
  }
  return keys;
}

std::string AllForms() {
  const Descriptor& state = *v1::OrbitState::descriptor();
  std::string forms;
  for (int i = 0; i < state.field_count(); ++i) {
    absl::StrAppend(&forms, "\n  ", state.field(i)->name(), ": ", AllowedKeys(*state.field(i)->message_type()));
  }
  return forms;
}

absl::StatusOr<Values> ParseValues(const std::string& text) {
  Values values;
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    const auto pair = ParsePair(std::string(part));
    if (!pair.ok()) return pair.status();
    const auto number = ParseNumber<double>(pair->second);
    if (!number.ok()) return absl::InvalidArgumentError(absl::StrCat(pair->first, ": ", number.status().message()));
    const auto same = [&](const auto& value) { return value.first == pair->first; };
    if (std::any_of(values.begin(), values.end(), same)) {
      return absl::InvalidArgumentError(absl::StrCat("'", pair->first, "' is given twice"));
    }
    values.emplace_back(pair->first, *number);
  }
  return values;
}

// The form that knows the most of the keys; the first of them where several do.
const FieldDescriptor* BestForm(const Values& values) {
  const Descriptor& state = *v1::OrbitState::descriptor();
  const FieldDescriptor* best = nullptr;
  std::ptrdiff_t most = 0;
  for (int i = 0; i < state.field_count(); ++i) {
    const std::ptrdiff_t known = std::count_if(values.begin(), values.end(), [&](const auto& value) {
      return state.field(i)->message_type()->FindFieldByName(value.first) != nullptr;
    });
    if (known > most) best = state.field(i);
    most = std::max(most, known);
  }
  return best;
}

absl::Status SetValues(const Values& values, const std::string& form_name, Message* form) {
  const Descriptor& descriptor = *form->GetDescriptor();
  for (const auto& [key, number] : values) {
    const FieldDescriptor* const field = descriptor.FindFieldByName(key);
    if (field == nullptr) {
      return absl::InvalidArgumentError(absl::StrCat("'", key, "' does not belong to the ", form_name, " form (",
                                                     AllowedKeys(descriptor), ") that the other keys tell"));
    }
    if (field->containing_oneof() != nullptr && form->GetReflection()->HasOneof(*form, field->containing_oneof())) {
      return absl::InvalidArgumentError(absl::StrCat("'", key, "' is one position too many: give one of ",
                                                     descriptor.field(descriptor.field_count() - 2)->name(), " and ",
                                                     descriptor.field(descriptor.field_count() - 1)->name()));
    }
    form->GetReflection()->SetDouble(form, field, number);
  }
  return absl::OkStatus();
}

absl::Status CheckComplete(const Values& values, const std::string& form_name, const Descriptor& form) {
  std::vector<std::string> missing;
  for (int i = 0; i < form.field_count(); ++i) {
    const std::string& name = form.field(i)->name();
    const bool given =
        std::any_of(values.begin(), values.end(), [&](const auto& value) { return value.first == name; });
    if (!given && form.field(i)->containing_oneof() == nullptr) missing.push_back(name);
  }
  if (missing.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("the ", form_name, " form lacks ", absl::StrJoin(missing, ", ")));
}

}  // namespace

absl::StatusOr<v1::OrbitState> ParseInitialCondition(const std::string& text) {
  v1::OrbitState state;
  if (!absl::StrContains(text, '=') || absl::EndsWith(text, ".json")) {
    if (const absl::Status status = ReadJsonFile(text, &state); !status.ok()) return status;
    return state;
  }
  const absl::StatusOr<Values> values = ParseValues(text);
  if (!values.ok()) return values.status();
  const FieldDescriptor* const field = BestForm(*values);
  if (field == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", values->front().first, "' is not a key of any form; the forms are", AllForms()));
  }
  Message* const form = state.GetReflection()->MutableMessage(&state, field);
  absl::Status status = SetValues(*values, field->name(), form);
  if (status.ok()) status = CheckComplete(*values, field->name(), *field->message_type());
  if (!status.ok()) return status;
  return state;
}

}  // namespace orbitune::cli
