#include "server/log/log.h"

#include <poll.h>
#include <unistd.h>

#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <mutex>
#include <utility>

namespace orbitune {
namespace {

constexpr std::array<std::string_view, 4> kLevels = {"debug", "info", "warning", "error"};

struct Logger {
  std::mutex mutex;
  // Guarded by mutex.
  LogOptions options;
  int lost = 0;  // lines since the last one that was written
};

Logger& TheLogger() {
  static auto* logger = new Logger;  // outlives whatever logs at exit
  return *logger;
}

template <typename T>
std::string NumberText(T value) {
  std::array<char, 32> buffer{};
  return {buffer.data(), std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr};
}

std::string TimeText(std::int64_t time_us) {
  const std::time_t seconds = static_cast<std::time_t>(time_us / 1'000'000);
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  std::array<char, 48> text{};
  const std::size_t length = std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%S", &utc);
  std::snprintf(text.data() + length, text.size() - length, ".%06dZ", static_cast<int>(time_us % 1'000'000));
  return text.data();
}

// As a JSON string, which is also how text that is no plain word stands in key=value. One line, whatever is in it.
std::string Quoted(std::string_view text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      quoted += '\\';
      quoted += c;
    } else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
      std::array<char, 8> escape{};
      std::snprintf(escape.data(), escape.size(), "\\u%04x", static_cast<unsigned>(c));
      quoted += escape.data();
    } else {
      quoted += c;
    }
  }
  return quoted + '"';
}

// Whole UTF-8 characters of it, so that a line fits into a pipe at once.
std::string Shortened(const std::string& text) {
  constexpr std::size_t kLongest = 1000;
  if (text.size() <= kLongest) return text;
  std::size_t end = kLongest;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xc0) == 0x80) --end;
  return text.substr(0, end) + "...";
}

// Who logs must not wait for whoever reads: what a pipe has no room for is lost, and counted.
void WriteLine(Logger& logger, std::int64_t time_us, const std::string& line) {
  pollfd standard_error{.fd = STDERR_FILENO, .events = POLLOUT, .revents = 0};
  if (poll(&standard_error, 1, 0) != 1) {
    ++logger.lost;
    return;
  }
  if (logger.lost > 0) {
    const std::string lost = FormatLogLine(logger.options.json, time_us, LogLevel::kWarning,
                                           "lines of the log were lost here", {{"lines", logger.lost}});
    std::fprintf(stderr, "%s\n", lost.c_str());
    logger.lost = 0;
  }
  std::fprintf(stderr, "%s\n", line.c_str());
}

bool IsPlain(std::string_view text) {
  for (const char c : text) {
    if (c <= ' ' || c == '"' || c == '\\' || c == '=' || c == 0x7f) return false;
  }
  return true;
}

}  // namespace

std::string_view NameOf(LogLevel level) { return kLevels[static_cast<std::size_t>(level)]; }

std::optional<LogLevel> LogLevelFrom(std::string_view name) {
  for (std::size_t i = 0; i < kLevels.size(); ++i) {
    if (kLevels[i] == name) return static_cast<LogLevel>(i);
  }
  return std::nullopt;
}

LogField::LogField(std::string_view k, double v)
    : key(k), value(std::isfinite(v) ? NumberText(v) : ""), is_number(true) {}
LogField::LogField(std::string_view k, std::int64_t v) : key(k), value(NumberText(v)), is_number(true) {}

std::string FormatLogLine(bool json, std::int64_t time_us, LogLevel level, std::string_view message,
                          std::initializer_list<LogField> fields) {
  std::string line = json ? "{\"time\":\"" + TimeText(time_us) + "\",\"level\":\"" + std::string(NameOf(level)) +
                                "\",\"message\":" + Quoted(message)
                          : TimeText(time_us) + " " + std::string(NameOf(level)) + " " + std::string(message);
  for (const LogField& field : fields) {
    if (field.value.empty()) continue;
    const std::string value = Shortened(field.value);
    const bool quote = json ? !field.is_number : !IsPlain(value);
    line += json ? ",\"" : " ";
    line += field.key;
    line += json ? "\":" : "=";
    line += quote ? Quoted(value) : value;
  }
  return json ? line + '}' : line;
}

void SetUpLog(LogOptions options) {
  Logger& logger = TheLogger();
  const std::lock_guard lock(logger.mutex);
  logger.options = std::move(options);
}

bool IsLogged(LogLevel level) {
  Logger& logger = TheLogger();
  const std::lock_guard lock(logger.mutex);
  return level >= logger.options.level;
}

void Log(LogLevel level, std::string_view message, std::initializer_list<LogField> fields) {
  Logger& logger = TheLogger();
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const std::lock_guard lock(logger.mutex);
  if (level < logger.options.level) return;
  const std::int64_t time_us = std::chrono::duration_cast<std::chrono::microseconds>(now).count();
  const std::string line = FormatLogLine(logger.options.json, time_us, level, message, fields);
  if (logger.options.sink) return logger.options.sink(line);
  WriteLine(logger, time_us, line);
}

}  // namespace orbitune
