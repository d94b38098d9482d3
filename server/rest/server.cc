// The one translation unit that includes Boost. All that is here runs on the I/O thread, but for what is said to be
// called from elsewhere: it leaves its result in a Slot.
#include "server/rest/server.h"

#include <sys/socket.h>
#include <sys/uio.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/as_tuple.hpp>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/network_v6.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <ctime>
#include <exception>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <utility>
#include <variant>

#include "absl/strings/str_cat.h"
#include "core/base/status.h"
#include "server/jobs/limit.h"
#include "server/log/log.h"
#include "server/rest/error.h"
#include "server/rest/gateway.h"
#include "server/rest/transport.h"

namespace orbitune {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using boost::system::error_code;
using net::ip::tcp;
using Clock = std::chrono::steady_clock;
using rest::Gateway;
using rest::HttpReply;
using rest::HttpRequest;
using rest::StreamReply;

constexpr auto kAwait = net::as_tuple(net::use_awaitable);
constexpr std::size_t kBatch = 256;             // events in one write: bounds what is held for a reader
constexpr std::size_t kMostIgnored = 64 << 10;  // bytes that a watcher may send without being asked
constexpr std::chrono::milliseconds kLinger{1000};
constexpr std::chrono::milliseconds kLingerForBody{5000};  // where the client may be sending what was refused
// With many watchers each is written to less often, and more at a time.
constexpr std::chrono::microseconds kPacePerStream{400};
constexpr std::chrono::microseconds kSlowestPace{200'000};
constexpr int kStreamSendBuffer = 256 << 10;  // what the system holds for a reader, likewise

constexpr std::string_view kRetry = "retry: 1000\n\n";
constexpr std::string_view kHeartbeat = ": heartbeat\n\n";
constexpr std::string_view kChunkEnd = "\r\n";
constexpr std::string_view kLastChunk = "0\r\n\r\n";

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
    api.executors().For(Work::kStream).Post([core = shared_from_this(), asks = std::move(asks)] {
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

// A batch of a feed, as text: pieces of the runs' own, which watchers share, or one made here.
struct Chunk {
  std::vector<net::const_buffer> text;
  std::vector<StreamPart> parts;  // these hold what `text` points into
  std::vector<std::shared_ptr<const std::string>> own;
  bool full = false;          // there may be more at once
  bool nothing_more = false;  // the first message is the last
  std::optional<absl::Status> end;
};

net::const_buffer Keep(std::string text, Chunk& chunk) {
  chunk.own.push_back(std::make_shared<const std::string>(std::move(text)));
  return net::buffer(*chunk.own.back());
}

// As HTTP/1.1 has a chunk of a body.
void Frame(Chunk& chunk) {
  if (chunk.text.empty()) return;
  chunk.text.insert(chunk.text.begin(), Keep(absl::StrCat(absl::Hex(net::buffer_size(chunk.text)), "\r\n"), chunk));
  chunk.text.push_back(net::buffer(kChunkEnd));
}

Chunk ToChunk(Feed::Batch batch, bool sse) {
  Chunk chunk;
  chunk.parts = std::move(batch.parts);
  chunk.end = batch.end;
  chunk.nothing_more = !chunk.parts.empty() && chunk.parts.front().front()->about.last;
  std::size_t count = 0;
  std::string lines;
  for (const StreamPart& part : chunk.parts) {
    count += part.size();
    if (sse) {
      chunk.text.push_back(net::buffer(part.run->Events(part.begin, part.end)));
    } else {
      for (std::size_t i = part.begin; i < part.end; ++i) absl::StrAppend(&lines, ToAbsl(part.run->Line(i)), "\n");
    }
  }
  chunk.full = count == kBatch;
  if (!lines.empty()) chunk.text = {Keep(std::move(lines), chunk)};
  if (batch.end && !batch.end->ok()) {
    const std::string error = rest::ErrorJson(*batch.end);
    chunk.text = {Keep(sse ? absl::StrCat("event: error\ndata: ", error, "\n\n") : error + "\n", chunk)};
  }
  return chunk;
}

// A watcher's socket for the threads for streams, which send what goes at once: unlike the I/O thread, for which every
// request waits, they step back behind the tuning. What is left is the I/O thread's; one of the two writes at a time.
class Outlet {
 public:
  explicit Outlet(int socket) : socket_(socket) {}

  // To be called before the socket is closed: then no more is sent.
  void Detach() {
    const std::lock_guard lock(mutex_);
    socket_ = -1;
  }

  // False if the other side has it.
  bool Take() { return !taken_.exchange(true); }
  void GiveBack() { taken_ = false; }

  // Sends what goes without waiting and removes it from `text`.
  void Send(std::vector<net::const_buffer>& text) {
    const std::lock_guard lock(mutex_);
    if (socket_ < 0) return;
    std::vector<iovec> pieces;
    for (const net::const_buffer& piece : text) pieces.push_back({const_cast<void*>(piece.data()), piece.size()});
    msghdr message{};
    message.msg_iov = pieces.data();
    message.msg_iovlen = std::min<std::size_t>(pieces.size(), kMostPieces);
    const ssize_t sent = sendmsg(socket_, &message, MSG_DONTWAIT | MSG_NOSIGNAL);
    auto left = sent > 0 ? static_cast<std::size_t>(sent) : 0;
    auto first = text.begin();
    for (; first != text.end() && left >= first->size(); ++first) left -= first->size();
    if (first != text.end()) *first += left;
    text.erase(text.begin(), first);
  }

 private:
  static constexpr std::size_t kMostPieces = 1024;  // of a call; what is beyond is left

  std::atomic<bool> taken_ = false;
  std::mutex mutex_;
  int socket_;  // guarded by mutex_; -1: detached
};

std::string HttpDate() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%a, %d %b %Y %H:%M:%S GMT", &utc);
  return text;
}

// For a coroutine that threw: its connection is closed with it, the others go on.
auto Report(Core& core) {
  return [&core](const std::exception_ptr& thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const std::exception& error) {
      core.Log(absl::StrCat("a connection failed: ", error.what()));
    }
  };
}

class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(Core& core, tcp::socket socket, std::string client)
      : core_(core),
        client_(std::move(client)),
        stream_(std::move(socket), core.NewTlsConnection()),
        buffer_(core.options.max_header_bytes + (128 << 10)) {
    core_.connections.insert(this);
    ++core_.clients[client_].connections;
  }
  ~Connection() {
    if (outlet_ != nullptr) outlet_->Detach();
    core_.body_bytes -= body_bytes_;
    core_.connections.erase(this);
    const auto client = core_.clients.find(client_);
    if (--client->second.connections == 0) core_.clients.erase(client);
    if (core_.draining && core_.connections.empty()) core_.grace.cancel();
  }

  static net::awaitable<void> Run(std::shared_ptr<Connection> self) {
    bool open = co_await self->Greet();  // g++ 12 gets a co_await in a loop's condition wrong
    while (open) open = co_await self->Serve();
    co_await self->Close();
  }

  // Whether no request is under way; then a drain may close it.
  bool idle() const { return idle_; }
  void CloseNow() {
    if (outlet_ != nullptr) outlet_->Detach();
    error_code ignored;
    stream_.socket().close(ignored);
  }

 private:
  using Parser = http::request_parser<http::string_body>;

  struct Stream {
    std::shared_ptr<Feed> feed;
    bool sse;
    bool chunked;
    std::shared_ptr<Slot<Chunk>> slot;
    std::string peer;  // HOST:PORT
    bool begun = false;
  };

  // False if the connection is to be closed.
  net::awaitable<bool> Greet() {
    if (!stream_.secure()) co_return true;
    stream_.expires_after(core_.options.header_time);
    const auto [error] = co_await stream_.async_handshake(kAwait);
    co_return !error;
  }

  // One request and its reply. False if the connection is to be closed.
  net::awaitable<bool> Serve() {
    Parser parser;
    body_limit_ = core_.options.max_body_bytes;
    parser.header_limit(static_cast<std::uint32_t>(core_.options.max_header_bytes));
    parser.body_limit(body_limit_);
    error_code error = co_await ReadHead(parser);
    const unsigned version = parser.get().version();
    if (error) {
      co_await Refuse(error, version);
      co_return false;
    }
    HttpRequest request = HeadOf(parser);
    const bool head = request.method == "HEAD";
    const bool keep_alive = parser.get().keep_alive();
    const std::string target = request.target;
    if (auto refusal = CheckHead(request, parser)) {
      linger_ = kLingerForBody;
      co_return co_await Write(*std::move(refusal), version, head, false);
    }
    error = co_await ReadBody(parser);
    if (error) {
      co_await Refuse(error, version);
      co_return false;
    }
    request.body = std::move(parser.get().body());
    Gateway::Reply reply = co_await Ask(std::move(request));
    ReleaseBody();
    if (auto* stream = std::get_if<StreamReply>(&reply)) {
      co_await Watch(std::move(*stream), version, head, target);
      co_return false;
    }
    co_return co_await Write(std::get<HttpReply>(std::move(reply)), version, head, keep_alive);
  }

  net::awaitable<error_code> ReadHead(Parser& parser) {
    if (core_.draining) co_return http::error::end_of_stream;
    if (buffer_.size() == 0) {
      idle_ = true;
      stream_.expires_after(core_.options.idle_time);
      const auto [error, count] = co_await stream_.async_read_some(buffer_.prepare(4096), kAwait);
      idle_ = false;
      if (error) co_return http::error::end_of_stream;
      buffer_.commit(count);
    }
    co_return co_await ReadWithin(core_.options.header_time, parser, [&] { return parser.is_header_done(); });
  }

  // Before any of the body is received: what the request is refused with.
  std::optional<HttpReply> CheckHead(const HttpRequest& head, Parser& parser) {
    const std::string_view host = head.header("Host");
    if (host.find(',') != std::string_view::npos || (parser.get().version() >= 11 && host.empty())) {
      return core_.gateway->Refuse(absl::InvalidArgumentError("Host: must be given once"), 400);
    }
    if (parser.is_done()) return std::nullopt;
    auto admitted = core_.gateway->AdmitBody(head);
    if (auto* refusal = std::get_if<HttpReply>(&admitted)) return std::move(*refusal);
    const std::size_t limit = std::get<std::size_t>(admitted);
    if (parser.content_length().value_or(0) > limit) return BodyTooLarge(limit);
    body_limit_ = limit;
    parser.body_limit(limit);
    return std::nullopt;
  }

  HttpReply BodyTooLarge(std::size_t limit) const {
    const std::string text = absl::StrCat("the body: must be at most ", limit, " bytes");
    return core_.gateway->Refuse(absl::InvalidArgumentError(text), 413);
  }

  net::awaitable<error_code> ReadBody(Parser& parser) {
    if (!parser.is_done() && beast::iequals(parser.get()[http::field::expect], "100-continue")) {
      static constexpr std::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";
      stream_.expires_after(core_.options.body_time);
      const auto [error, count] = co_await net::async_write(stream_, net::buffer(kContinue), kAwait);
      if (error) co_return error;
    }
    const error_code error = co_await ReadWithin(core_.options.body_time, parser, [&] { return parser.is_done(); });
    if (!error && buffer_.size() == 0) buffer_.shrink_to_fit();
    co_return error;
  }

  // Reads until `done`; timed_out where that takes too long. A stream's own time limit closes it: here another timer
  // ends the read, so that the reason can still be told.
  net::awaitable<error_code> ReadWithin(std::chrono::milliseconds time, Parser& parser, std::function<bool()> done) {
    const auto late = std::make_shared<bool>(false);
    net::steady_timer timer(core_.io, time);
    timer.async_wait([late, self = shared_from_this()](error_code error) {
      if (error || late.use_count() == 1) return;  // all was read
      *late = true;
      self->stream_.socket().cancel(error);
    });
    stream_.expires_never();
    while (!done()) {
      const auto [error, count] = co_await http::async_read_some(stream_, buffer_, parser, kAwait);
      if (*late) co_return net::error::make_error_code(net::error::timed_out);
      if (error) co_return error;
      const std::size_t size = parser.get().body().size();  // what is only announced is not touched, and costs nothing
      core_.body_bytes += size - body_bytes_;
      body_bytes_ = size;
      if (core_.body_bytes > core_.options.max_bodies_bytes) {
        co_return net::error::make_error_code(net::error::no_buffer_space);
      }
    }
    co_return error_code();
  }

  void ReleaseBody() {
    core_.body_bytes -= body_bytes_;
    body_bytes_ = 0;
  }

  HttpRequest HeadOf(Parser& parser) {
    auto& message = parser.get();
    HttpRequest request;
    request.peer = PeerAddress();
    request.secure = stream_.secure();
    request.method = message.method_string();
    request.target = message.target();
    for (const auto& field : message) {
      std::string& value = request.headers[std::string(field.name_string())];
      absl::StrAppend(&value, value.empty() ? "" : ", ", std::string(field.value()));
    }
    return request;
  }

  // Answers what is no request, where there is anybody to answer.
  net::awaitable<void> Refuse(error_code error, unsigned version) {
    const HttpOptions& limits = core_.options;
    std::optional<HttpReply> reply;
    const auto answer = [&](const absl::Status& status, int code) { reply = core_.gateway->Refuse(status, code); };
    if (error == http::error::header_limit || error == http::error::buffer_overflow) {
      const std::string text = absl::StrCat("the request's head: must be at most ", limits.max_header_bytes, " bytes");
      answer(absl::InvalidArgumentError(text), 431);
    } else if (error == http::error::body_limit) {
      reply = BodyTooLarge(body_limit_);
    } else if (error == net::error::timed_out) {
      answer(absl::DeadlineExceededError(absl::StrCat("the request: its head must be there within ",
                                                      limits.header_time.count(), " ms, its body within ",
                                                      limits.body_time.count(), " ms")),
             408);
    } else if (error == net::error::no_buffer_space) {
      answer(LimitExceeded("bytes of all bodies being received",
                           {"http-max-bodies-bytes", static_cast<std::int64_t>(limits.max_bodies_bytes)},
                           "try again when some have been"),
             429);
    } else if (error.category() == http::make_error_code(http::error::bad_method).category() &&
               error != http::error::end_of_stream && error != http::error::partial_message) {
      answer(absl::InvalidArgumentError(absl::StrCat("not HTTP: ", error.message())), 400);
    }
    if (error == http::error::body_limit || error == net::error::no_buffer_space) linger_ = kLingerForBody;
    if (reply) co_await Write(*std::move(reply), std::max(version, 10U), false, false);
  }

  net::awaitable<Gateway::Reply> Ask(HttpRequest request) {
    auto slot = std::make_shared<Slot<Gateway::Reply>>(core_.io);
    auto gone = std::make_shared<std::atomic<bool>>(false);
    core_.gateway->Handle(
        std::move(request), [gone] { return gone->load(); },
        [core = core_.shared_from_this(), slot](Gateway::Reply reply) { slot->Put(core, std::move(reply)); });
    // Readable and nothing to read: the caller has gone.
    stream_.socket().async_wait(tcp::socket::wait_read, [self = shared_from_this(), gone](error_code error) {
      char byte = 0;
      if (!error && recv(self->stream_.socket().native_handle(), &byte, 1, MSG_PEEK | MSG_DONTWAIT) == 0) *gone = true;
    });
    co_await slot->WaitUntil(Clock::time_point::max());
    error_code ignored;
    stream_.socket().cancel(ignored);  // the wait
    co_return slot->Take();
  }

  template <typename Body>
  void SetHeaders(http::response<Body>& response,
                  const std::vector<std::pair<std::string, std::string>>& headers) const {
    response.set(http::field::date, HttpDate());
    for (const auto& [name, value] : headers) response.insert(name, value);
  }

  // False if the connection is to be closed. The body goes out in pieces, each of which has to be taken in time.
  net::awaitable<bool> Write(HttpReply reply, unsigned version, bool head, bool keep_alive) {
    http::response<http::string_body> response{static_cast<http::status>(reply.code), version};
    SetHeaders(response, reply.headers);
    keep_alive = keep_alive && !core_.draining;
    response.keep_alive(keep_alive);
    const bool has_body = reply.code != 204 && reply.code != 304;
    if (has_body) response.content_length(reply.body.size());
    if (has_body && !head) response.body() = std::move(reply.body);
    http::response_serializer<http::string_body> serializer{response};
    if (head) serializer.split(true);
    while (head ? !serializer.is_header_done() : !serializer.is_done()) {
      stream_.expires_after(core_.options.stall_time);
      const auto [error, count] = co_await http::async_write_some(stream_, serializer, kAwait);
      if (error) co_return false;
    }
    co_return keep_alive;
  }

  // A stream's life: its first batch decides what kind of answer it is.
  net::awaitable<void> Watch(StreamReply reply, unsigned version, bool head, std::string target) {
    Stream stream{.feed = reply.feed,
                  .sse = reply.sse,
                  .chunked = version >= 11,
                  .slot = std::make_shared<Slot<Chunk>>(core_.io),
                  .peer = Peer()};
    core_.PostAsks({AskOf(stream)});
    co_await stream.slot->WaitUntil(Clock::time_point::max());
    Chunk first = stream.slot->Take();
    if (first.end) {
      HttpReply error = rest::ErrorReply(*first.end);
      error.headers.insert(error.headers.end(), reply.headers.begin() + 1, reply.headers.end());
      co_await Write(std::move(error), version, head, false);
    } else if (reply.resumed && first.nothing_more) {
      // A browser's EventSource takes this for the end, and nothing else.
      HttpReply over{.code = 204, .headers = reply.headers, .body = {}};
      co_await Write(std::move(over), version, head, false);
    } else {
      const bool begun = co_await WriteStreamHead(stream, reply, version);
      if (begun && !head) co_await Follow(stream, std::move(first), std::move(target));
    }
    stream.feed->End(absl::CancelledError("the watcher is gone"));
  }

  net::awaitable<void> Follow(Stream& stream, Chunk first, std::string target) {
    ++core_.streams;
    const auto self = shared_from_this();
    net::co_spawn(core_.io, NoticeEnd(self, stream.feed), Report(core_));
    stream.begun = true;
    if (!stream_.secure()) outlet_ = std::make_shared<Outlet>(stream_.socket().native_handle());
    co_await Pump(stream, std::move(first), target);
    --core_.streams;
  }

  // The feed may read the store and makes JSON: on a thread for that.
  Core::Ask AskOf(const Stream& stream) const {
    return [feed = stream.feed, slot = stream.slot, outlet = outlet_, sse = stream.sse,
            framed = stream.begun && stream.chunked](const std::shared_ptr<Core>& core) {
      feed->Next(kBatch, [core, slot, outlet, sse, framed](Feed::Batch batch) {
        Chunk chunk = ToChunk(std::move(batch), sse);
        if (framed) Frame(chunk);
        if (outlet != nullptr && outlet->Take()) outlet->Send(chunk.text);
        slot->Put(core, std::move(chunk));
      });
    };
  }

  net::awaitable<bool> WriteStreamHead(const Stream& stream, const StreamReply& reply, unsigned version) {
    error_code ignored;
    stream_.socket().set_option(net::socket_base::send_buffer_size(kStreamSendBuffer), ignored);
    http::response<http::empty_body> response{http::status::ok, version};
    SetHeaders(response, reply.headers);
    response.keep_alive(false);
    response.chunked(stream.chunked);
    http::response_serializer<http::empty_body> serializer{response};
    stream_.expires_after(core_.options.stall_time);
    const auto [error, count] = co_await http::async_write_header(stream_, serializer, kAwait);
    co_return !error;
  }

  net::awaitable<void> Pump(Stream& stream, Chunk chunk, const std::string& target) {
    if (stream.sse) chunk.text.insert(chunk.text.begin(), net::buffer(kRetry));
    if (stream.chunked) Frame(chunk);
    while (true) {
      const bool alive = co_await WriteText(stream, chunk.text, target);
      if (!alive) co_return;
      if (outlet_ != nullptr) outlet_->GiveBack();
      if (chunk.end) break;
      if (chunk.full) {
        core_.PostAsks({AskOf(stream)});
      } else {
        core_.AskAtNextTurn(AskOf(stream));
      }
      while (true) {
        const bool filled = co_await stream.slot->WaitUntil(Clock::now() + core_.options.heartbeat);
        if (filled) break;
        const bool there = co_await Beat(stream, target);
        if (!there) co_return;
      }
      chunk = stream.slot->Take();
    }
    const std::vector<net::const_buffer> last_chunk{net::buffer(kLastChunk)};
    if (stream.chunked) co_await WriteText(stream, last_chunk, target);
  }

  // Unless something is being sent right now.
  net::awaitable<bool> Beat(const Stream& stream, const std::string& target) {
    if (!stream.sse || (outlet_ != nullptr && !outlet_->Take())) co_return true;
    Chunk chunk;
    chunk.text = {net::buffer(kHeartbeat)};
    if (stream.chunked) Frame(chunk);
    const bool there = co_await WriteText(stream, chunk.text, target);
    if (outlet_ != nullptr) outlet_->GiveBack();
    co_return there;
  }

  // False if the connection is to be closed.
  net::awaitable<bool> WriteText(const Stream& stream, std::vector<net::const_buffer> text, const std::string& target) {
    if (text.empty()) co_return true;
    // Not the stream's own time limit, which would close the socket and leave the outlet none the wiser.
    const auto late = std::make_shared<bool>(false);
    net::steady_timer timer(core_.io, core_.options.stall_time);
    timer.async_wait([late, self = shared_from_this()](error_code cancelled) {
      if (cancelled || late.use_count() == 1) return;  // all was written
      *late = true;
      self->CloseNow();
    });
    stream_.expires_never();
    const auto [error, count] = co_await net::async_write(stream_, text, kAwait);
    if (*late) {
      core_.Log(absl::StrCat("cut off ", stream.peer, " at ", target, ": it did not take what it asked for within ",
                             core_.options.stall_time.count(), " ms"));
    }
    co_return !error;
  }

  // Ends the feed when the watcher goes; nothing is expected from it.
  static net::awaitable<void> NoticeEnd(std::shared_ptr<Connection> self, std::shared_ptr<Feed> feed) {
    std::size_t ignored_bytes = 0;
    while (ignored_bytes < kMostIgnored) {
      const auto [error, count] = co_await self->ReadIgnored();
      if (error) break;
      ignored_bytes += count;
    }
    feed->End(absl::CancelledError("the watcher is gone"));
    self->CloseNow();
  }

  // Without a time limit, and leaving that of a write under way alone.
  net::awaitable<std::tuple<error_code, std::size_t>> ReadIgnored() {
    const auto buffer = net::buffer(core_.ignored);
    if (!stream_.secure()) co_return co_await stream_.socket().async_read_some(buffer, kAwait);
    const auto [error] = co_await stream_.socket().async_wait(tcp::socket::wait_read, kAwait);
    if (error) co_return std::tuple(error, std::size_t{0});
    stream_.expires_after(core_.options.stall_time);
    co_return co_await stream_.async_read_some(buffer, kAwait);
  }

  // What was sent arrives before the connection ends, also where the other side still sends: what comes is taken, until
  // nothing has for kLinger, or linger_ is over. Closed with something unread, the system would take the answer back.
  net::awaitable<void> Close() {
    if (outlet_ != nullptr) outlet_->Detach();
    error_code error;
    stream_.expires_after(kLinger);
    if (stream_.secure()) co_await stream_.async_shutdown(kAwait);
    stream_.socket().shutdown(tcp::socket::shutdown_send, error);
    const auto end = Clock::now() + linger_;
    net::steady_timer timer(core_.io);
    // Under TLS, too, without reading what it says. By a clock of its own: where there is always something to read, the
    // stream's never comes to its turn.
    while (!error && Clock::now() < end) {
      timer.expires_after(kLinger);
      timer.async_wait([self = shared_from_this()](error_code cancelled) {
        if (!cancelled) self->CloseNow();
      });
      error = std::get<0>(co_await stream_.socket().async_read_some(net::buffer(core_.ignored), kAwait));
    }
    CloseNow();
  }

  std::string PeerAddress() {
    error_code error;
    const tcp::endpoint endpoint = stream_.socket().remote_endpoint(error);
    return error ? "?" : endpoint.address().to_string();
  }

  std::string Peer() {
    error_code error;
    const tcp::endpoint endpoint = stream_.socket().remote_endpoint(error);
    return error ? "?" : absl::StrCat(endpoint.address().to_string(), ":", endpoint.port());
  }

  Core& core_;
  const std::string client_;
  Transport stream_;
  std::shared_ptr<Outlet> outlet_;  // of a stream in the clear, once it has begun
  beast::flat_buffer buffer_;
  std::size_t body_bytes_ = 0;
  std::size_t body_limit_ = 0;  // of the request at hand
  std::chrono::milliseconds linger_ = kLinger;
  bool idle_ = false;
};

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
      const auto connection = std::make_shared<Connection>(core, std::move(socket), std::move(client));
      net::co_spawn(core.io, Connection::Run(connection), Report(core));
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
    net::co_spawn(core_->io, Accept(*core_, acceptor_), Report(*core_));
    thread_ = std::thread([this] { core_->io.run(); });
  }

  const std::string& address() const override { return address_; }

  void SetServing(const absl::Status& state) override { core_->gateway->SetServing(state); }

  void Shutdown(std::chrono::milliseconds grace) override {
    core_->gateway->SetServing(absl::UnavailableError("the server is going down"));
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
    for (Connection* connection : core_->connections) {
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
