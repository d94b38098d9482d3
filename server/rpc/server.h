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
  struct Limits {
    int max_request_bytes = kLargestRequestBytes;
    int max_streams_per_connection = 2000;  // calls at a time; a client waits with what comes beyond
    std::int64_t memory_bytes = 256 << 20;  // that gRPC keeps for messages and connections
  };

  // Listens on `address` (HOST:PORT, port 0: any free one), or says why it cannot. api: outlives the server. tls: files
  // that TlsContext::Load takes; none: in the clear.
  static absl::StatusOr<std::unique_ptr<RpcServer>> Start(const std::string& address, Api& api, const TlsFiles& tls,
                                                          const Limits& limits);
  static absl::StatusOr<std::unique_ptr<RpcServer>> Start(const std::string& address, Api& api,
                                                          const TlsFiles& tls = {}) {
    return Start(address, api, tls, Limits());
  }

  virtual ~RpcServer() = default;

  // HOST:PORT as listened on.
  virtual const std::string& address() const = 0;

  // What health checking answers, until Shutdown.
  virtual void SetServing(bool serving) = 0;

  // Health says NOT_SERVING, the API's streams and calls are ended with UNAVAILABLE, what is in flight gets `grace`,
  // and it is over; at once where nothing is, whoever may still be connected.
  virtual void Shutdown(std::chrono::milliseconds grace) = 0;
};

}  // namespace orbitune
