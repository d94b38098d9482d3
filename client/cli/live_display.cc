#include "client/cli/live_display.h"

#include <ostream>

namespace orbitune::cli {
namespace {

constexpr std::chrono::milliseconds kFrame(66);

}  // namespace

LiveDisplay::LiveDisplay(const Terminal& terminal) : terminal_(terminal), thread_(&LiveDisplay::DrawLoop, this) {}

LiveDisplay::~LiveDisplay() {
  {
    const std::lock_guard lock(mu_);
    stopping_ = true;
  }
  stop_.notify_all();
  thread_.join();
  if (job_.name().empty()) return;
  Draw();
  *terminal_.out << std::endl;
}

void LiveDisplay::OnEvent(const v1::WatchJobResponse& event, const v1::Job& job) {
  const std::lock_guard lock(mu_);
  if (event.has_iteration() || event.has_snapshot()) {
    const std::chrono::duration<double> now = std::chrono::steady_clock::now() - start_;
    rate_.Add(now.count(), job.completed_iterations());
  } else if (event.has_state_change()) {
    rate_ = RateMeter();  // a pause is no part of the speed
  }
  job_ = job;
  changed_ = true;
}

void LiveDisplay::OnNote(const std::string& note) {
  const std::lock_guard lock(mu_);
  *terminal_.out << kClearLine << std::flush;
  *terminal_.err << "orbitune: " << note << std::endl;
  changed_ = true;
}

void LiveDisplay::DrawLoop() {
  std::unique_lock lock(mu_);
  while (!stop_.wait_for(lock, kFrame, [this] { return stopping_; })) {
    if (changed_ && !job_.name().empty()) Draw();
  }
}

void LiveDisplay::Draw() {
  changed_ = false;
  // The last column stays free: some terminals wrap as soon as it is written.
  *terminal_.out << kClearLine << ProgressLine(job_, rate_.PerSecond(), terminal_.width() - 1) << std::flush;
}

}  // namespace orbitune::cli
