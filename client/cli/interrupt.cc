#include "client/cli/interrupt.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdint>

namespace orbitune::cli {
namespace {

volatile sig_atomic_t signal_fd = -1;

void Wake(int fd) {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = write(fd, &one, sizeof one);
}

// All that a handler may do: the rest happens in the listener thread.
extern "C" void OnSignal(int /*signal*/) {
  const int saved = errno;
  Wake(signal_fd);
  errno = saved;
}

}  // namespace

Interrupt::Interrupt() : event_fd_(eventfd(0, EFD_CLOEXEC)) {
  signal_fd = event_fd_;
  listener_ = std::thread(&Interrupt::Listen, this);
  struct sigaction action {};
  action.sa_handler = OnSignal;
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_RESTART);
  sigaction(SIGINT, &action, &previous_);
}

Interrupt::~Interrupt() {
  sigaction(SIGINT, &previous_, nullptr);
  stopping_ = true;
  Wake(event_fd_);
  listener_.join();
  signal_fd = -1;
  close(event_fd_);
}

void Interrupt::Listen() {
  std::uint64_t count = 0;
  while (read(event_fd_, &count, sizeof count) != static_cast<ssize_t>(sizeof count) && errno == EINTR) {
  }
  const std::lock_guard lock(mu_);
  if (stopping_) return;
  requested_ = true;
  if (context_ != nullptr) context_->TryCancel();
  changed_.notify_all();
}

void Interrupt::Attach(grpc::ClientContext* context) {
  const std::lock_guard lock(mu_);
  context_ = context;
  if (context != nullptr && requested_) context->TryCancel();
}

bool Interrupt::WaitFor(double seconds) {
  std::unique_lock lock(mu_);
  return changed_.wait_for(lock, std::chrono::duration<double>(seconds), [this] { return requested_.load(); });
}

}  // namespace orbitune::cli
