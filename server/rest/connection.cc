#include "server/rest/connection.h"

#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/write.hpp>
#include <ctime>
#include <variant>

#include "absl/strings/str_cat.h"
#include "core/base/status.h"
#include "server/jobs/limit.h"
#include "server/rest/error.h"

namespace orbitune::rest {
namespace {

constexpr std::chrono::milliseconds kLingerForBody{5000};  // where the client may be sending what was refused

}  // namespace

std::string HttpDate() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%a, %d %b %Y %H:%M:%S GMT", &utc);
  return text;
}

Connection::Connection(Core& core, tcp::socket socket, std::string client)
    : core_(core),
      client_(std::move(client)),
      stream_(std::move(socket), core.NewTlsConnection()),
      buffer_(core.options.max_header_bytes + (128 << 10)) {
  core_.connections.insert(this);
  ++core_.clients[client_].connections;
}

Connection::~Connection() {
  if (outlet_ != nullptr) outlet_->Detach();
  core_.body_bytes -= body_bytes_;
  core_.connections.erase(this);
  const auto client = core_.clients.find(client_);
  if (--client->second.connections == 0) core_.clients.erase(client);
  if (core_.draining && core_.connections.empty()) core_.grace.cancel();
}

net::awaitable<void> Connection::Run(std::shared_ptr<Connection> self) {
  bool open = co_await self->Greet();  // g++ 12 gets a co_await in a loop's condition wrong
  while (open) open = co_await self->Serve();
  co_await self->Close();
}

void Connection::CloseNow() {
  if (outlet_ != nullptr) outlet_->Detach();
  error_code ignored;
  stream_.socket().close(ignored);
}

net::awaitable<bool> Connection::Greet() {
  if (!stream_.secure()) co_return true;
  stream_.expires_after(core_.options.header_time);
  const auto [error] = co_await stream_.async_handshake(kAwait);
  co_return !error;
}

net::awaitable<bool> Connection::Serve() {
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

net::awaitable<error_code> Connection::ReadHead(Parser& parser) {
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

std::optional<HttpReply> Connection::CheckHead(const HttpRequest& head, Parser& parser) {
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

HttpReply Connection::BodyTooLarge(std::size_t limit) const {
  const std::string text = absl::StrCat("the body: must be at most ", limit, " bytes");
  return core_.gateway->Refuse(absl::InvalidArgumentError(text), 413);
}

net::awaitable<error_code> Connection::ReadBody(Parser& parser) {
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

net::awaitable<error_code> Connection::ReadWithin(std::chrono::milliseconds time, Parser& parser,
                                                  std::function<bool()> done) {
  const Deadline deadline(core_.io, time, [self = shared_from_this()] {
    error_code ignored;
    self->stream_.socket().cancel(ignored);
  });
  stream_.expires_never();
  while (!done()) {
    const auto [error, count] = co_await http::async_read_some(stream_, buffer_, parser, kAwait);
    if (deadline.passed()) co_return net::error::make_error_code(net::error::timed_out);
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

void Connection::ReleaseBody() {
  core_.body_bytes -= body_bytes_;
  body_bytes_ = 0;
}

HttpRequest Connection::HeadOf(Parser& parser) {
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

net::awaitable<void> Connection::Refuse(error_code error, unsigned version) {
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

net::awaitable<Gateway::Reply> Connection::Ask(HttpRequest request) {
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

net::awaitable<bool> Connection::Write(HttpReply reply, unsigned version, bool head, bool keep_alive) {
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

net::awaitable<void> Connection::Close() {
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

std::string Connection::PeerAddress() {
  error_code error;
  const tcp::endpoint endpoint = stream_.socket().remote_endpoint(error);
  return error ? "?" : endpoint.address().to_string();
}

std::string Connection::Peer() {
  error_code error;
  const tcp::endpoint endpoint = stream_.socket().remote_endpoint(error);
  return error ? "?" : absl::StrCat(endpoint.address().to_string(), ":", endpoint.port());
}

}  // namespace orbitune::rest
