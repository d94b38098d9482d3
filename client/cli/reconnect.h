// Whether and when to connect again, after a stream was lost.
#pragma once

#include <chrono>
#include <functional>
#include <string>

#include "client/cli/interrupt.h"
#include "grpcpp/support/status.h"

namespace orbitune::cli {

// A stream that ends OK before its subject does is as good as lost; a server that shuts down hard may say CANCELLED.
bool IsTransportLoss(grpc::StatusCode code);

class Reconnect {
 public:
  // for_s: how long to try, counted from the loss; 0: not at all. note: told what happens. Both outlive this.
  Reconnect(double for_s, Interrupt& interrupt, std::function<void(const std::string&)> note)
      : for_s_(for_s), interrupt_(interrupt), note_(std::move(note)) {}

  // A message has come.
  void Connected();

  // Whether to go on after this loss; waits a little before it says yes.
  bool Await(const grpc::Status& loss);

 private:
  using Clock = std::chrono::steady_clock;

  const double for_s_;
  Interrupt& interrupt_;
  const std::function<void(const std::string&)> note_;
  // The present outage, if attempts_ > 0.
  int attempts_ = 0;
  Clock::time_point lost_at_;
};

}  // namespace orbitune::cli
