// The listener: who is let in, and the server's start and end.
#include "server/rest/server.h"

#include <algorithm>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/ip/network_v6.hpp>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status.h"
#include "server/jobs/limit.h"
#include "server/rest/connection.h"
#include "server/rest/core.h"
#include "server/rest/error.h"
#include "server/rest/gateway.h"

namespace orbitune {
namespace {

namespace net = boost::asio;
using boost::system::error_code;
using net::ip::tcp;
using rest::Core;
using rest::Gateway;
using rest::kAwait;

// Whom a connection counts for: an address; of IPv6 the network of 64 bits, which one machine may have to itself.
std::string ClientOf(const tcp::socket& socket) {
  error_code error;
  const net::ip::address address = socket.remote_endpoint(error).address();
  if (error) return "?";
  if (address.is_v4()) return address.to_string();
  const net::ip::address_v6 v6 = address.to_v6();
  if (v6.is_v4_mapped()) return net::ip::make_address_v4(net::ip::v4_mapped, v6).to_string();
  return net::ip::make_network_v6(v6, 64).canonical().to_string();
}

// RESOURCE_EXHAUSTED where one more connection would be too many; the first time, it is logged.
absl::Status CheckRoom(Core& core, const std::string& client) {
  constexpr std::string_view kLater = "try again when one has been closed";
  const HttpOptions& options = core.options;
  const auto told = [&core](bool& full, const std::string& line) {
    if (!std::exchange(full, true)) core.Log(line);
  };
  if (core.connections.size() >= static_cast<std::size_t>(options.max_connections)) {
    told(core.full, absl::StrCat("all ", options.max_connections, " connections are in use"));
    return LimitExceeded("HTTP connections", {"http-max-connections", options.max_connections}, kLater);
  }
  core.full = false;
  const auto known = core.clients.find(client);
  if (known == core.clients.end() || known->second.connections < options.max_connections_per_client) {
    return absl::OkStatus();
  }
  told(known->second.full,
       absl::StrCat(client, " has all ", options.max_connections_per_client, " connections that a client may have"));
  return LimitExceeded("HTTP connections of one client",
                       {"http-max-connections-per-client", options.max_connections_per_client}, kLater);
}

// Refuses who comes beyond a limit, if the system takes the answer at once.
void TurnAway(const Core& core, tcp::socket socket, const absl::Status& status) {
  if (core.tls != nullptr) return;  // whom a handshake would cost more than the answer is worth
  const std::string body = rest::ErrorJson(status) + "\n";
  const std::string answer =
      absl::StrCat("HTTP/1.1 429 Too Many Requests\r\nContent-Type: application/json\r\nContent-Length: ", body.size(),
                   "\r\nRetry-After: 1\r\nConnection: close\r\n\r\n", body);
  error_code ignored;
  socket.non_blocking(true, ignored);
  socket.write_some(net::buffer(answer), ignored);
  socket.shutdown(tcp::socket::shutdown_send, ignored);
}

net::awaitable<void> Accept(Core& core, tcp::acceptor& acceptor) {
  while (true) {
    auto [error, socket] = co_await acceptor.async_accept(kAwait);
    if (!acceptor.is_open()) co_return;
    std::string client = error ? "" : ClientOf(socket);
    if (error) {  // no file descriptors, say
      net::steady_timer timer(core.io, std::chrono::milliseconds(100));
      co_await timer.async_wait(kAwait);
    } else if (const absl::Status room = CheckRoom(core, client); !room.ok()) {
      TurnAway(core, std::move(socket), room);
    } else {
      socket.set_option(tcp::no_delay(true), error);
      const auto connection = std::make_shared<rest::Connection>(core, std::move(socket), std::move(client));
      net::co_spawn(core.io, rest::Connection::Run(connection), rest::Report(core));
    }
  }
}

class HttpServerImpl final : public HttpServer {
 public:
  HttpServerImpl(HttpOptions options, Api& api)
      : core_(std::make_shared<Core>(std::move(options), api)), acceptor_(core_->io) {}

  ~HttpServerImpl() override {
    core_->io.stop();
    if (thread_.joinable()) thread_.join();
  }

  absl::Status Listen() {
    if (core_->options.tls.on()) {
      auto tls = TlsContext::Load(core_->options.tls);
      if (!tls.ok()) return tls.status();
      core_->tls = *std::move(tls);
    }
    const std::string& address = core_->options.address;
    const std::size_t colon = address.rfind(':');
    std::string host = address.substr(0, colon);
    if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
    error_code error;
    tcp::resolver resolver(core_->io);
    const auto endpoints = resolver.resolve(host, address.substr(colon + 1), tcp::resolver::passive, error);
    if (!error) Open(*endpoints.begin(), error);
    if (error) {
      return absl::UnavailableError(
          absl::StrCat("cannot listen on ", FormatReceived(address), " (HTTP): ", error.message()));
    }
    address_ = absl::StrCat(address.substr(0, colon), ":", acceptor_.local_endpoint().port());
    return absl::OkStatus();
  }

  void Run() {
    const bool is_loopback = acceptor_.local_endpoint().address().is_loopback();
    core_->gateway =
        std::make_shared<Gateway>(core_->api, rest::GatewayOptions{.web_dir = core_->options.web_dir,
                                                                   .cors_origins = core_->options.cors_origins,
                                                                   .local_hosts_only = is_loopback,
                                                                   .max_body_bytes = core_->options.max_body_bytes,
                                                                   .metrics = core_->options.metrics});
    net::co_spawn(core_->io, Accept(*core_, acceptor_), rest::Report(*core_));
    thread_ = std::thread([this] { core_->io.run(); });
  }

  const std::string& address() const override { return address_; }

  void SetServing(const absl::Status& state) override { core_->gateway->SetServing(state); }

  void Shutdown(std::chrono::milliseconds grace) override {
    core_->gateway->SetServing(GoingDown());
    net::post(core_->io, [this, grace] { BeginShutdown(grace); });
    core_->api.Drain();
    if (thread_.joinable()) thread_.join();  // once nothing is left to do
    core_->draining = false;                 // what is left of connections has nobody to tell
  }

 private:
  void Open(const tcp::endpoint& endpoint, error_code& error) {
    acceptor_.open(endpoint.protocol(), error);
    if (!error) acceptor_.set_option(tcp::acceptor::reuse_address(true), error);
    if (!error) acceptor_.bind(endpoint, error);
    if (!error) acceptor_.listen(net::socket_base::max_listen_connections, error);
  }

  // On the I/O thread.
  void BeginShutdown(std::chrono::milliseconds grace) {
    error_code ignored;
    acceptor_.close(ignored);
    core_->draining = true;
    if (core_->connections.empty()) return;
    core_->grace.expires_after(grace);
    core_->grace.async_wait([core = core_.get()](error_code error) {
      if (!error) core->io.stop();
    });
    for (rest::Connection* connection : core_->connections) {
      if (connection->idle()) connection->CloseNow();
    }
  }

  const std::shared_ptr<Core> core_;
  tcp::acceptor acceptor_;
  std::string address_;
  std::thread thread_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<HttpServer>> HttpServer::Start(HttpOptions options, Api& api) {
  auto server = std::make_unique<HttpServerImpl>(std::move(options), api);
  if (absl::Status status = server->Listen(); !status.ok()) return status;
  server->Run();
  return server;
}

}  // namespace orbitune
