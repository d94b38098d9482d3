// Page tokens: opaque to a client, checked on the way back in.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace orbitune {

// A token for a position (`parts`, any text) in the list that `list` identifies: its filter, order and parent.
std::string MakePageToken(std::string_view list, const std::vector<std::string>& parts);

// The parts again. INVALID_ARGUMENT for field "page_token" if the token was not made for this list, or is damaged.
absl::StatusOr<std::vector<std::string>> ReadPageToken(std::string_view token, std::string_view list,
                                                       std::size_t part_count);

// The page size to use: `default_size` for 0, at most `largest`. INVALID_ARGUMENT for a negative one.
absl::StatusOr<int> PageSize(int requested, int default_size, int largest);

}  // namespace orbitune
