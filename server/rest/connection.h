// A connection over HTTP: its requests, one after another (connection.cc), until one of them is a stream
// (connection_stream.cc), which is the last. Everything runs on the I/O thread.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "server/rest/chunk.h"
#include "server/rest/core.h"

namespace orbitune::rest {

// As a header of a reply has the time.
std::string HttpDate();

class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(Core& core, tcp::socket socket, std::string client);
  ~Connection();

  static net::awaitable<void> Run(std::shared_ptr<Connection> self);

  // Whether no request is under way; then a drain may close it.
  bool idle() const { return idle_; }
  void CloseNow();

 private:
  static constexpr std::chrono::milliseconds kLinger{1000};
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
  net::awaitable<bool> Greet();

  // One request and its reply. False if the connection is to be closed.
  net::awaitable<bool> Serve();
  net::awaitable<error_code> ReadHead(Parser& parser);

  // Before any of the body is received: what the request is refused with.
  std::optional<HttpReply> CheckHead(const HttpRequest& head, Parser& parser);
  HttpReply BodyTooLarge(std::size_t limit) const;
  net::awaitable<error_code> ReadBody(Parser& parser);

  // Reads until `done`; timed_out where that takes too long. A stream's own time limit closes it: here another timer
  // ends the read, so that the reason can still be told.
  net::awaitable<error_code> ReadWithin(std::chrono::milliseconds time, Parser& parser, std::function<bool()> done);
  void ReleaseBody();
  HttpRequest HeadOf(Parser& parser);

  // Answers what is no request, where there is anybody to answer.
  net::awaitable<void> Refuse(error_code error, unsigned version);
  net::awaitable<Gateway::Reply> Ask(HttpRequest request);

  template <typename Body>
  void SetHeaders(http::response<Body>& response,
                  const std::vector<std::pair<std::string, std::string>>& headers) const {
    response.set(http::field::date, HttpDate());
    for (const auto& [name, value] : headers) response.insert(name, value);
  }

  // False if the connection is to be closed. The body goes out in pieces, each of which has to be taken in time.
  net::awaitable<bool> Write(HttpReply reply, unsigned version, bool head, bool keep_alive);

  // A stream's life: its first batch decides what kind of answer it is.
  net::awaitable<void> Watch(StreamReply reply, unsigned version, bool head, std::string target);
  net::awaitable<void> Follow(Stream& stream, Chunk first, std::string target);

  // The feed may read the store and makes JSON: on a thread for that.
  Core::Ask AskOf(const Stream& stream) const;
  net::awaitable<bool> WriteStreamHead(const Stream& stream, const StreamReply& reply, unsigned version);
  net::awaitable<void> Pump(Stream& stream, Chunk chunk, const std::string& target);

  // Unless something is being sent right now.
  net::awaitable<bool> Beat(const Stream& stream, const std::string& target);

  // False if the connection is to be closed.
  net::awaitable<bool> WriteText(const Stream& stream, std::vector<net::const_buffer> text, const std::string& target);

  // Ends the feed when the watcher goes; nothing is expected from it.
  static net::awaitable<void> NoticeEnd(std::shared_ptr<Connection> self, std::shared_ptr<Feed> feed);

  // Without a time limit, and leaving that of a write under way alone.
  net::awaitable<std::tuple<error_code, std::size_t>> ReadIgnored();

  // What was sent arrives before the connection ends, also where the other side still sends: what comes is taken, until
  // nothing has for kLinger, or linger_ is over. Closed with something unread, the system would take the answer back.
  net::awaitable<void> Close();
  std::string PeerAddress();
  std::string Peer();

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

}  // namespace orbitune::rest
