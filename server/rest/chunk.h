// What is sent to a watcher at once, and the thread-safe way to its socket.
#pragma once

#include <sys/socket.h>
#include <sys/uio.h>

#include <atomic>
#include <boost/asio/buffer.hpp>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "server/api/feed.h"

namespace orbitune::rest {

namespace net = boost::asio;

inline constexpr std::size_t kBatch = 256;  // events in one write: bounds what is held for a reader

// A batch of a feed, as text: pieces of the runs' own, which watchers share, or one made here.
struct Chunk {
  std::vector<net::const_buffer> text;
  std::vector<StreamPart> parts;  // these hold what `text` points into
  std::vector<std::shared_ptr<const std::string>> own;
  bool full = false;          // there may be more at once
  bool nothing_more = false;  // the first message is the last
  std::optional<absl::Status> end;
};

// As HTTP/1.1 has a chunk of a body.
void Frame(Chunk& chunk);

// A batch as Server-Sent Events, or as a line each.
Chunk ToChunk(Feed::Batch batch, bool sse);

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

}  // namespace orbitune::rest
