// The HTTP server: sockets, limits and time-outs around the gateway, on one thread of its own.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/access/tls.h"
#include "server/api/api.h"

namespace orbitune {

struct HttpOptions {
  std::string address = "127.0.0.1:7314";  // HOST:PORT, port 0: any free one
  TlsFiles tls;
  std::string web_dir;                    // the dashboard's files; need not exist
  std::vector<std::string> cors_origins;  // pages from elsewhere that may call this server, "*": all
  int max_connections = 1024;             // what comes beyond is answered 429
  int max_connections_per_client = 768;   // of one address (of IPv6, of a network of 64 bits), likewise
  std::size_t max_header_bytes = 16 << 10;
  std::size_t max_body_bytes = kLargestRequestBytes;
  std::size_t max_bodies_bytes = 64 << 20;        // of all requests that are being received
  std::chrono::milliseconds header_time{10'000};  // a request's head must be there by then
  std::chrono::milliseconds body_time{60'000};    // and its body
  std::chrono::milliseconds idle_time{60'000};    // between two requests
  std::chrono::milliseconds stall_time{30'000};   // a reader that takes nothing is cut off
  std::chrono::milliseconds heartbeat{15'000};    // a stream without events says that it is there
  std::function<void(const std::string&)> log;    // a line without its end; unset: the server's log
  std::function<std::string()> metrics;           // what /metrics answers; unset: there are none
};

class HttpServer {
 public:
  // Listens, or says why it cannot. api: outlives the server.
  static absl::StatusOr<std::unique_ptr<HttpServer>> Start(HttpOptions options, Api& api);

  virtual ~HttpServer() = default;  // at once, where it was not shut down

  // HOST:PORT as listened on.
  virtual const std::string& address() const = 0;

  // What /readyz answers, until Shutdown: OK, or why the server takes no work.
  virtual void SetServing(const absl::Status& state) = 0;

  // Nobody new, the API's streams are ended with UNAVAILABLE, requests in flight get `grace`, and it is over.
  virtual void Shutdown(std::chrono::milliseconds grace) = 0;
};

}  // namespace orbitune
