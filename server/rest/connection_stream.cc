// A connection whose request was for a stream.
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/write.hpp>

#include "absl/strings/str_cat.h"
#include "server/rest/connection.h"
#include "server/rest/error.h"

namespace orbitune::rest {
namespace {

constexpr std::size_t kMostIgnored = 64 << 10;  // bytes that a watcher may send without being asked
constexpr int kStreamSendBuffer = 256 << 10;    // what the system holds for a reader, likewise

constexpr std::string_view kRetry = "retry: 1000\n\n";
constexpr std::string_view kHeartbeat = ": heartbeat\n\n";
constexpr std::string_view kLastChunk = "0\r\n\r\n";

}  // namespace

net::awaitable<void> Connection::Watch(StreamReply reply, unsigned version, bool head, std::string target) {
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

net::awaitable<void> Connection::Follow(Stream& stream, Chunk first, std::string target) {
  ++core_.streams;
  const auto self = shared_from_this();
  net::co_spawn(core_.io, NoticeEnd(self, stream.feed), Report(core_));
  stream.begun = true;
  if (!stream_.secure()) outlet_ = std::make_shared<Outlet>(stream_.socket().native_handle());
  co_await Pump(stream, std::move(first), target);
  --core_.streams;
}

Core::Ask Connection::AskOf(const Stream& stream) const {
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

net::awaitable<bool> Connection::WriteStreamHead(const Stream& stream, const StreamReply& reply, unsigned version) {
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

net::awaitable<void> Connection::Pump(Stream& stream, Chunk chunk, const std::string& target) {
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

net::awaitable<bool> Connection::Beat(const Stream& stream, const std::string& target) {
  if (!stream.sse || (outlet_ != nullptr && !outlet_->Take())) co_return true;
  Chunk chunk;
  chunk.text = {net::buffer(kHeartbeat)};
  if (stream.chunked) Frame(chunk);
  const bool there = co_await WriteText(stream, chunk.text, target);
  if (outlet_ != nullptr) outlet_->GiveBack();
  co_return there;
}

net::awaitable<bool> Connection::WriteText(const Stream& stream, std::vector<net::const_buffer> text,
                                           const std::string& target) {
  if (text.empty()) co_return true;
  // Not the stream's own time limit, which would close the socket and leave the outlet none the wiser.
  const Deadline deadline(core_.io, core_.options.stall_time, [self = shared_from_this()] { self->CloseNow(); });
  stream_.expires_never();
  const auto [error, count] = co_await net::async_write(stream_, text, kAwait);
  if (deadline.passed()) {
    core_.Log(absl::StrCat("cut off ", stream.peer, " at ", target, ": it did not take what it asked for within ",
                           core_.options.stall_time.count(), " ms"));
  }
  co_return !error;
}

net::awaitable<void> Connection::NoticeEnd(std::shared_ptr<Connection> self, std::shared_ptr<Feed> feed) {
  std::size_t ignored_bytes = 0;
  while (ignored_bytes < kMostIgnored) {
    const auto [error, count] = co_await self->ReadIgnored();
    if (error) break;
    ignored_bytes += count;
  }
  feed->End(absl::CancelledError("the watcher is gone"));
  self->CloseNow();
}

net::awaitable<std::tuple<error_code, std::size_t>> Connection::ReadIgnored() {
  const auto buffer = net::buffer(core_.ignored);
  if (!stream_.secure()) co_return co_await stream_.socket().async_read_some(buffer, kAwait);
  const auto [error] = co_await stream_.socket().async_wait(tcp::socket::wait_read, kAwait);
  if (error) co_return std::tuple(error, std::size_t{0});
  stream_.expires_after(core_.options.stall_time);
  co_return co_await stream_.async_read_some(buffer, kAwait);
}

}  // namespace orbitune::rest
