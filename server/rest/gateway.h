// Everything between an HTTP request and its reply but the socket: routes, JSON, errors, origins, the dashboard's
// files.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <variant>
#include <vector>

#include "server/api/api.h"
#include "server/rest/http.h"
#include "server/rest/routes.h"
#include "server/rest/static_files.h"

namespace orbitune::rest {

struct GatewayOptions {
  std::string web_dir;                    // the dashboard's files
  std::vector<std::string> cors_origins;  // "https://example.org": pages that may call this server from elsewhere
  // Refuse Host headers that are neither localhost nor an IP address nor an allowed origin's, so that no page can make
  // a browser take this server for its own (DNS rebinding).
  bool local_hosts_only = false;
  std::size_t max_body_bytes = kLargestRequestBytes;
  std::function<std::string()> metrics;  // what /metrics answers; may block; unset: there are none
};

// A reply that goes on: messages of a feed, as Server-Sent Events or a line each.
struct StreamReply {
  std::shared_ptr<Feed> feed;
  bool sse = false;
  bool resumed = false;  // by Last-Event-ID: the browser has been here before
  std::vector<std::pair<std::string, std::string>> headers;
};

// Thread-safe. Tasks hold on to it: it may be let go of while requests are answered.
class Gateway : public std::enable_shared_from_this<Gateway> {
 public:
  using Reply = std::variant<HttpReply, StreamReply>;

  // api: outlives all that is under way.
  Gateway(Api& api, GatewayOptions options);

  // Of a request whose head alone has come: how many bytes its body may have, or what it is refused with at once, so
  // that a large body is received only from who may do what it asks for. Does not block.
  std::variant<std::size_t, HttpReply> AdmitBody(const HttpRequest& head) const;

  // Calls `done` once, from within or from another thread. Does not block.
  void Handle(HttpRequest request, Cancelled cancelled, std::function<void(Reply)> done);

  // What a request gets that never became one: a syntax error, a limit exceeded.
  HttpReply Refuse(const absl::Status& status, int http_code) const;

  // What /readyz answers: OK, or why the server takes no work.
  void SetServing(const absl::Status& state) {
    const std::lock_guard lock(state_mutex_);
    state_ = state;
  }

 private:
  struct Exchange;

  Reply Fixed(const HttpRequest& request, const Target& target) const;
  absl::Status CheckOrigin(const HttpRequest& request) const;
  void HandleSession(const std::shared_ptr<Exchange>& exchange);
  // Who sends a request to a method, or why it is refused whatever its body says.
  std::variant<Caller, HttpReply> Admit(const Method& method, const HttpRequest& request, bool has_body) const;
  bool IsAllowedOrigin(std::string_view origin) const;
  void HandleRoute(const RouteTable::Match& match, const std::shared_ptr<Exchange>& exchange);
  void HandleFile(const std::shared_ptr<Exchange>& exchange);
  void HandleMetrics(const std::shared_ptr<Exchange>& exchange);
  void Post(Work work, const std::shared_ptr<Exchange>& exchange, std::function<void()> task);
  void CallMethod(const RouteTable::Match& match, const std::shared_ptr<Exchange>& exchange);
  static HttpReply Answer(const Exchange& exchange);
  Reply OpenStream(const RouteTable::Match& match, Exchange& exchange) const;
  HttpReply Preflight(const HttpRequest& request, const std::vector<std::string>& allowed) const;
  using Headers = std::vector<std::pair<std::string, std::string>>;
  // What every reply has.
  void AddHeaders(const HttpRequest& request, Headers& headers) const;
  void Send(const Exchange& exchange, Reply reply) const;

  Api& api_;
  const GatewayOptions options_;
  const RouteTable routes_;
  const StaticFiles files_;
  const std::string openapi_;
  mutable std::mutex state_mutex_;
  absl::Status state_;  // guarded by state_mutex_
};

}  // namespace orbitune::rest
