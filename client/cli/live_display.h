// A watched job on a terminal: one line, redrawn in place.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

#include "client/cli/app.h"
#include "client/cli/progress.h"
#include "client/cli/watch_sinks.h"

namespace orbitune::cli {

// Draws from a thread of its own, about 15 times a second at most, and only what has changed: events cost nothing
// more, and the last of a burst is not left out.
class LiveDisplay : public WatchSink {
 public:
  // `terminal` must outlive the display.
  explicit LiveDisplay(const Terminal& terminal);
  ~LiveDisplay() override;  // leaves the last line, drawn once more, above the cursor

  void OnEvent(const v1::WatchJobResponse& event, const v1::Job& job) override;
  void OnNote(const std::string& note) override;

 private:
  void DrawLoop();
  void Draw();  // needs mu_

  const Terminal& terminal_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::mutex mu_;
  std::condition_variable stop_;
  bool stopping_ = false;  // this and the rest: guarded by mu_
  bool changed_ = false;
  v1::Job job_;
  RateMeter rate_;
  std::thread thread_;
};

}  // namespace orbitune::cli
