#include "server/commands/support.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

namespace orbitune {
namespace {

// "24h": 24 hours; nothing for anything else.
std::optional<absl::Duration> ParseAgo(const std::string& text) {
  int count = 0;
  if (text.empty() || !absl::SimpleAtoi(text.substr(0, text.size() - 1), &count) || count < 0) return std::nullopt;
  switch (text.back()) {
    case 'm':
      return absl::Minutes(count);
    case 'h':
      return absl::Hours(count);
    case 'd':
      return absl::Hours(24) * count;
    default:
      return std::nullopt;
  }
}

std::string Printable(std::string text) {
  std::ranges::replace_if(
      text, [](char c) { return static_cast<unsigned char>(c) < ' ' || c == '\x7f'; }, '?');
  return text;
}

}  // namespace

absl::StatusOr<std::unique_ptr<AccessStore>> OpenAccessStore(const std::string& data_dir) {
  std::error_code error;
  std::filesystem::create_directories(data_dir, error);
  struct stat about {};
  if (error || stat(data_dir.c_str(), &about) != 0) {
    return absl::UnavailableError(absl::StrCat("--data-dir ", data_dir, ": cannot be made or read: ", error.message()));
  }
  if (about.st_uid != geteuid()) {
    return absl::FailedPreconditionError(absl::StrCat("--data-dir ", data_dir, ": belongs to user ", about.st_uid,
                                                      ", this is user ", geteuid(), ": run as that one (sudo -u '#",
                                                      about.st_uid, "' orbituned ...)"));
  }
  return AccessStore::Open(data_dir + "/access.db");
}

std::string FormatTime(std::int64_t time_us) {
  if (time_us == 0) return "never";
  return absl::FormatTime("%Y-%m-%dT%H:%M:%SZ", absl::FromUnixMicros(time_us), absl::UTCTimeZone());
}

absl::StatusOr<std::int64_t> ParseTime(const std::string& option, const std::string& text, std::int64_t now_us) {
  if (const auto ago = ParseAgo(text)) return now_us - absl::ToInt64Microseconds(*ago);
  for (const char* const format : {"%Y-%m-%d", "%Y-%m-%dT%H:%M:%E*S%Ez"}) {
    absl::Time time;
    std::string unused;
    if (absl::ParseTime(format, text, absl::UTCTimeZone(), &time, &unused)) return absl::ToUnixMicros(time);
  }
  return InvalidOption(option, "a time (2026-11-22, 2026-11-22T10:00:00Z) or so long ago (90m, 24h, 7d)", text);
}

std::string FormatTable(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> widths;
  for (const auto& row : rows) {
    widths.resize(std::max(widths.size(), row.size()));
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string text;
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      absl::StrAppend(&text, Printable(row[i]));
      if (i + 1 < row.size()) text.append(widths[i] - row[i].size() + 2, ' ');
    }
    text += '\n';
  }
  return text;
}

absl::Status InvalidOption(const std::string& option, const std::string& allowed, const std::string& received) {
  FieldErrors errors;
  errors.Add(option, allowed, received);
  return errors.ToStatus();
}

int FailCommand(const absl::Status& status) {
  std::fprintf(stderr, "orbituned: %s\n", std::string(status.message()).c_str());
  return absl::IsInvalidArgument(status) ? 2 : 1;
}

}  // namespace orbitune
