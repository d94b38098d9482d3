// proto3 JSON as every JSON of ours is written: the proto's field names (their units stay legible, and errors name
// fields by them), and unset numbers, strings and lists as well. The same as the command line's.
#pragma once

#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "google/protobuf/message.h"

namespace orbitune {

// One line, without its end.
std::string ToJson(const google::protobuf::Message& message);

// The same in every byte, by protobuf alone: what ToJson is held against.
std::string ToJsonByProtobuf(const google::protobuf::Message& message);

// Field names in either form. INVALID_ARGUMENT, saying where, for what is no such message.
absl::Status FromJson(const std::string& json, google::protobuf::Message* message);

// Text as a JSON string. text: UTF-8.
std::string QuoteJson(std::string_view text);

}  // namespace orbitune
