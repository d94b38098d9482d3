// What the HTTP server's connections share, and how they wait for other threads. All of it is the I/O thread's, but for
// what is said to be called from elsewhere: it leaves its result in a Slot.
#pragma once

#include <algorithm>
#include <boost/asio/as_tuple.hpp>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/log/log.h"
#include "server/rest/gateway.h"
#include "server/rest/server.h"
#include "server/rest/transport.h"

namespace orbitune::rest {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using boost::system::error_code;
using net::ip::tcp;
using Clock = std::chrono::steady_clock;

inline constexpr auto kAwait = net::as_tuple(net::use_awaitable);

// With many watchers each is written to less often, and more at a time.
inline constexpr std::chrono::microseconds kPacePerStream{400};
inline constexpr std::chrono::microseconds kSlowestPace{200'000};
// More than so many take what is left of the processors.
inline constexpr int kCrowd = 64;

class Connection;

// What connections share. Tasks of the API's executors hold on to it, so that they can outlive the server.
struct Core : std::enable_shared_from_this<Core> {
  Core(HttpOptions given, Api& served) : options(std::move(given)), api(served) {}

  void Log(const std::string& line) const {
    if (options.log) return options.log(line);
    orbitune::Log(LogLevel::kWarning, "http", {{"what", line}});
  }

  // Asks on a thread for streams, together with all who wait by then: watchers of one job that ask together get the
  // same pieces of text, and one task does it for all of them. The more there are, the rarer the turns.
  using Ask = std::function<void(const std::shared_ptr<Core>&)>;
  void AskAtNextTurn(Ask ask) {
    waiting.push_back(std::move(ask));
    if (waiting.size() > 1) return;
    const Clock::duration pace = std::min<Clock::duration>(std::max(streams, 1) * kPacePerStream, kSlowestPace);
    const Clock::duration now = Clock::now().time_since_epoch();
    turn.expires_at(Clock::time_point(now - now % pace + pace));
    turn.async_wait([this](error_code) { PostAsks(std::exchange(waiting, {})); });
  }
  void PostAsks(std::vector<Ask> asks) {
    const Work work = streams > kCrowd ? Work::kCrowd : Work::kStream;
    api.executors().For(work).Post([core = shared_from_this(), asks = std::move(asks)] {
      for (const Ask& ask : asks) ask(core);
    });
  }

  // nullptr: in the clear.
  SSL* NewTlsConnection() const {
    return tls == nullptr ? nullptr : tls->NewConnection([this](const std::string& line) { Log(line); });
  }

  const HttpOptions options;
  Api& api;
  std::shared_ptr<Gateway> gateway;
  std::unique_ptr<TlsContext> tls;  // nullptr: in the clear
  std::set<Connection*> connections;
  struct Client {
    int connections = 0;
    bool full = false;  // it was logged
  };
  std::map<std::string, Client> clients;  // by ClientOf; those that have connections
  std::size_t body_bytes = 0;             // of requests that are being received
  int streams = 0;
  bool draining = false;
  bool full = false;  // connections; it was logged
  char ignored[16 << 10];
  net::io_context io{1};  // the last: destroys the coroutines that are left, which use the rest
  net::steady_timer grace{io};
  net::steady_timer turn{io};
  std::vector<Ask> waiting;  // for the next turn
};

// Where another thread leaves what a coroutine waits for.
template <typename T>
class Slot : public std::enable_shared_from_this<Slot<T>> {
 public:
  explicit Slot(net::io_context& io) : signal_(io) {}

  // Fills the slot, from any thread. `core` keeps the I/O context.
  void Put(const std::shared_ptr<Core>& core, T value) {
    net::post(core->io, [self = this->shared_from_this(), value = std::move(value)]() mutable {
      self->value_ = std::move(value);
      self->signal_.cancel();
    });
  }

  // False at the deadline.
  net::awaitable<bool> WaitUntil(Clock::time_point deadline) {
    if (!value_) {
      signal_.expires_at(deadline);
      co_await signal_.async_wait(kAwait);
    }
    co_return value_.has_value();
  }

  T Take() { return *std::exchange(value_, std::nullopt); }

 private:
  net::steady_timer signal_;
  std::optional<T> value_;
};

// Calls `act` on the I/O thread once `time` is over, unless it goes before that.
class Deadline {
 public:
  Deadline(net::io_context& io, std::chrono::milliseconds time, std::function<void()> act) : timer_(io, time) {
    timer_.async_wait([passed = passed_, act = std::move(act)](error_code cancelled) {
      if (cancelled || passed.use_count() == 1) return;
      *passed = true;
      act();
    });
  }

  bool passed() const { return *passed_; }

 private:
  const std::shared_ptr<bool> passed_ = std::make_shared<bool>(false);
  net::steady_timer timer_;
};

// For a coroutine that threw: its connection is closed with it, the others go on.
inline auto Report(Core& core) {
  return [&core](const std::exception_ptr& thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const std::exception& error) {
      core.Log(absl::StrCat("a connection failed: ", error.what()));
    }
  };
}

}  // namespace orbitune::rest
