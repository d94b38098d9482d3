// What the commands share: the data directory's store of tokens, times as people write them, and tables.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/base/clock.h"
#include "storage/access_store.h"

namespace orbitune {

// access.db of the data directory, which is made if need be. FAILED_PRECONDITION where it is another user's: the
// server, which runs as that one, could not open what we would make there.
absl::StatusOr<std::unique_ptr<AccessStore>> OpenAccessStore(const std::string& data_dir);

// "2026-11-22T10:00:00Z"; "never" for 0.
std::string FormatTime(std::int64_t time_us);

// "2026-11-22", "2026-11-22T10:00:00Z", or so long ago: "90m", "24h", "7d". INVALID_ARGUMENT naming the option.
absl::StatusOr<std::int64_t> ParseTime(const std::string& option, const std::string& text, std::int64_t now_us);

// Columns as wide as they need to be, the first line a heading. What could steer a terminal is shown as "?".
std::string FormatTable(const std::vector<std::vector<std::string>>& rows);

// INVALID_ARGUMENT naming the option, what it may be, and what it was.
absl::Status InvalidOption(const std::string& option, const std::string& allowed, const std::string& received);

// Prints the error; returns the exit status.
int FailCommand(const absl::Status& status);

}  // namespace orbitune
