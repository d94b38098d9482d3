#include "server/api/call_log.h"

#include "core/base/status.h"
#include "server/log/log.h"

namespace orbitune {
namespace {

constexpr int kMostLinesASecond = 50;

// What an operator should hear of; what a caller gets wrong is the caller's business.
LogLevel LevelOf(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kInternal:
    case absl::StatusCode::kUnknown:
    case absl::StatusCode::kDataLoss:
      return LogLevel::kError;
    case absl::StatusCode::kUnavailable:
    case absl::StatusCode::kResourceExhausted:
    case absl::StatusCode::kPermissionDenied:
    case absl::StatusCode::kUnauthenticated:
      return LogLevel::kWarning;
    default:
      return LogLevel::kDebug;
  }
}

// These may take long: it is what they are for.
bool TakesItsTime(const Method& method) { return method.open != nullptr || method.work == Work::kEpisode; }

}  // namespace

bool CallLog::HasRoom() {
  const auto now = std::chrono::steady_clock::now();
  int left_out = 0;
  bool has_room = false;
  {
    const std::lock_guard lock(mutex_);
    if (now - second_ >= std::chrono::seconds(1)) {
      second_ = now;
      lines_ = 0;
      left_out = std::exchange(left_out_, 0);
    }
    has_room = lines_ < kMostLinesASecond;
    ++(has_room ? lines_ : left_out_);
  }
  if (left_out > 0) Log(LogLevel::kWarning, "calls were left out of the log", {{"calls", left_out}});
  return has_room;
}

void CallLog::Note(const Method& method, const Caller& caller, std::string_view resource, const absl::Status& status,
                   double seconds) {
  const bool slow = seconds > slow_call_s_ && !TakesItsTime(method) && !(method.work_of && seconds < 60);
  LogLevel level = LevelOf(status);
  if (slow && level < LogLevel::kWarning) level = LogLevel::kWarning;
  if (!IsLogged(level) || (level != LogLevel::kDebug && !HasRoom())) return;
  Log(level,
      slow          ? "slow call"
      : status.ok() ? "call"
                    : "call refused",
      {{"method", method.descriptor->name()},
       {"resource", resource},
       {"code", absl::StatusCodeToString(status.code())},
       {"ms", seconds * 1e3},
       {"client", caller.token_id.empty() ? caller.peer : caller.name},
       {"request", caller.request_id},
       {"error", std::string(status.message())}});
}

}  // namespace orbitune
