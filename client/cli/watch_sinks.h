// What a watcher does with a job's events: plain lines, JSON lines, or a live display (live_display.h).
#pragma once

#include <ostream>
#include <string>

#include "orbitune/v1/tuning.pb.h"

namespace orbitune::cli {

// Called by one thread.
class WatchSink {
 public:
  virtual ~WatchSink() = default;

  // `job` is what the events up to this one make of it.
  virtual void OnEvent(const v1::WatchJobResponse& event, const v1::Job& job) = 0;

  // Something about the watching itself, for stderr.
  virtual void OnNote(const std::string& note) = 0;
};

// Every event as one line of text or JSON.
class LineSink : public WatchSink {
 public:
  // Both streams must outlive the sink.
  LineSink(bool json, std::ostream& out, std::ostream& err) : json_(json), out_(out), err_(err) {}

  void OnEvent(const v1::WatchJobResponse& event, const v1::Job& job) override;
  void OnNote(const std::string& note) override;

 private:
  const bool json_;
  std::ostream& out_;
  std::ostream& err_;
};

}  // namespace orbitune::cli
