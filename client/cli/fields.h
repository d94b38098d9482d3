// Any message as lines `field_name  value` for people. The names are those of the .proto and of the JSON files.
#pragma once

#include <ostream>

#include "google/protobuf/message.h"

namespace orbitune::cli {

// Singular fields only; unset messages, unset optional fields and empty strings are left out. Gains take one line.
void PrintFields(const google::protobuf::Message& message, int indent, std::ostream& out);

}  // namespace orbitune::cli
