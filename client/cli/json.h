// Messages as proto3 JSON, under the names of the .proto files, with fields of value 0 written out.
#pragma once

#include <string>

#include "google/protobuf/message.h"

namespace orbitune::cli {

// One line, its end included.
std::string JsonLine(const google::protobuf::Message& message);

// Indented, for files that are edited by hand.
std::string JsonPretty(const google::protobuf::Message& message);

// A JSON string, quotes included.
std::string JsonQuote(const std::string& text);

}  // namespace orbitune::cli
