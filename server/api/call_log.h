// What is said of calls in the server's log: refusals, failures, slow ones; each of them at the level "debug".
#pragma once

#include <chrono>
#include <mutex>

#include "absl/status/status.h"
#include "server/access/caller.h"
#include "server/api/methods.h"

namespace orbitune {

// Thread-safe.
class CallLog {
 public:
  explicit CallLog(double slow_call_s) : slow_call_s_(slow_call_s) {}

  // resource: what it was about.
  void Note(const Method& method, const Caller& caller, std::string_view resource, const absl::Status& status,
            double seconds);

 private:
  // So that a flood of refusals is no flood of lines: false for what comes beyond so many a second.
  bool HasRoom();

  const double slow_call_s_;

  std::mutex mutex_;
  // Guarded by mutex_.
  std::chrono::steady_clock::time_point second_;
  int lines_ = 0;     // in it
  int left_out_ = 0;  // in it
};

}  // namespace orbitune
