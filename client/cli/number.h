// Numbers as typed: the whole text must be one number. NaN and infinity pass; ranges are the server's to judge.
#pragma once

#include <charconv>
#include <string>
#include <system_error>
#include <type_traits>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

namespace orbitune::cli {

template <typename T>
absl::StatusOr<T> ParseNumber(const std::string& text) {
  T value{};
  const char* const end = text.data() + text.size();
  const std::from_chars_result result = std::from_chars(text.data(), end, value);
  if (result.ec == std::errc::result_out_of_range) {
    return absl::InvalidArgumentError(absl::StrCat("'", text, "' does not fit its type"));
  }
  if (result.ec != std::errc() || result.ptr != end) {
    return absl::InvalidArgumentError(absl::StrCat("'", text, "' is not ",
                                                   std::is_floating_point_v<T> ? "a number" : "a whole number",
                                                   std::is_unsigned_v<T> ? " of 0 or more" : ""));
  }
  return value;
}

}  // namespace orbitune::cli
