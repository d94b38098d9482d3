// What is beyond a bound: RESOURCE_EXHAUSTED that says which bound, how much it allows and which option sets it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/status.h"

namespace orbitune {

struct Limit {
  std::string option;  // "max-queued-jobs": of the server
  std::int64_t value = 0;
};

// what: "jobs waiting to begin"; advice: when to try again.
absl::Status LimitExceeded(std::string_view what, const Limit& limit, std::string_view advice);

// The limit that a status tells of; none for another kind of status.
std::optional<Limit> LimitOf(const absl::Status& status);

}  // namespace orbitune
