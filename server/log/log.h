// What the server tells its operator: one line per event, on standard error, with the time in UTC, how serious it is,
// what happened, and the particulars as fields. Nothing secret may be given to it.
#pragma once

#include <cstdint>
#include <functional>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>

namespace orbitune {

enum class LogLevel { kDebug, kInfo, kWarning, kError };

// "debug", "info", "warning", "error".
std::string_view NameOf(LogLevel level);
std::optional<LogLevel> LogLevelFrom(std::string_view name);

// A particular: text, or a number that goes unquoted into JSON.
struct LogField {
  LogField(std::string_view k, std::string_view v) : key(k), value(v) {}
  LogField(std::string_view k, const std::string& v) : key(k), value(v) {}
  LogField(std::string_view k, const char* v) : key(k), value(v) {}
  LogField(std::string_view k, double v);
  LogField(std::string_view k, std::int64_t v);
  LogField(std::string_view k, int v) : LogField(k, static_cast<std::int64_t>(v)) {}

  std::string_view key;  // a literal: [a-z_]+
  std::string value;
  bool is_number = false;
};

struct LogOptions {
  LogLevel level = LogLevel::kInfo;  // what is less serious is left out
  bool json = false;                 // else key=value
  // Gets each line without its end, one at a time; unset: standard error, for which nobody waits.
  std::function<void(const std::string&)> sink;
};

// To be called before the threads that log are started. Tests call it again for a sink of their own.
void SetUpLog(LogOptions options);

bool IsLogged(LogLevel level);

// Thread-safe. Fields with an empty value are left out, long ones cut short.
void Log(LogLevel level, std::string_view message, std::initializer_list<LogField> fields = {});

// The line itself. time_us: since the Unix epoch.
std::string FormatLogLine(bool json, std::int64_t time_us, LogLevel level, std::string_view message,
                          std::initializer_list<LogField> fields);

}  // namespace orbitune
