// What a user types on the command line, to messages and names. Only the form is checked.
#pragma once

#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "orbitune/v1/orbit.pb.h"

namespace orbitune::cli {

// "k1,k2,k3,k4,k5": exactly five numbers.
absl::StatusOr<v1::Gains> ParseGains(const std::string& text);

// "key=value"; the key is not empty, the value may be and may hold '='.
absl::StatusOr<std::pair<std::string, std::string>> ParsePair(const std::string& text);

// `id` or `collection/id` to `collection/id`; "" stays "".
std::string ResourceName(const std::string& collection, const std::string& text);

// A random (version 4) UUID.
std::string RandomUuid();

}  // namespace orbitune::cli
