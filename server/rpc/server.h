// The gRPC server: the services of the API, health checking and reflection.
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/access/tls.h"
#include "server/api/api.h"

namespace orbitune {

class RpcServer {
 public:
  // Listens on `address` (HOST:PORT, port 0: any free one), or says why it cannot. api: outlives the server. tls: files
  // that TlsContext::Load takes; none: in the clear.
  static absl::StatusOr<std::unique_ptr<RpcServer>> Start(const std::string& address, Api& api,
                                                          const TlsFiles& tls = {});

  virtual ~RpcServer() = default;

  // HOST:PORT as listened on.
  virtual const std::string& address() const = 0;

  // What health checking answers, until Shutdown.
  virtual void SetServing(bool serving) = 0;

  // Health says NOT_SERVING, the API's streams are ended with UNAVAILABLE, calls in flight get `grace`, and it is over.
  virtual void Shutdown(std::chrono::milliseconds grace) = 0;
};

}  // namespace orbitune
