// The gRPC server: the three services over the service layer, health checking and reflection.
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "server/service/use_cases.h"

namespace orbitune {

class RpcServer {
 public:
  // Listens on `address` (HOST:PORT, port 0: any free one), or says why it cannot. use_cases: outlives the server.
  static absl::StatusOr<std::unique_ptr<RpcServer>> Start(const std::string& address, UseCases& use_cases);

  virtual ~RpcServer() = default;

  // HOST:PORT as listened on.
  virtual const std::string& address() const = 0;

  // What health checking answers, until Shutdown.
  virtual void SetServing(bool serving) = 0;

  // Health says NOT_SERVING, watchers are ended with UNAVAILABLE, calls in flight get `grace`, and it is over.
  virtual void Shutdown(std::chrono::milliseconds grace) = 0;
};

}  // namespace orbitune
