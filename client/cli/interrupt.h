// Ctrl-C while a job is watched: ends the wait or the call in flight instead of the program.
#pragma once

#include <signal.h>

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "grpcpp/client_context.h"

namespace orbitune::cli {

// Takes SIGINT over for its lifetime; one at a time. A second SIGINT ends the program as ever.
class Interrupt {
 public:
  Interrupt();
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  bool requested() const { return requested_; }

  // The call to cancel on SIGINT, at once if there was one; nullptr for none. Not owned.
  void Attach(grpc::ClientContext* context);

  // Waits; returns true if interrupted before the time is over.
  bool WaitFor(double seconds);

 private:
  void Listen();

  int event_fd_;
  struct sigaction previous_ {};
  std::atomic<bool> requested_ = false;
  std::atomic<bool> stopping_ = false;
  std::mutex mu_;
  std::condition_variable changed_;
  grpc::ClientContext* context_ = nullptr;  // guarded by mu_
  std::thread listener_;
};

}  // namespace orbitune::cli
