// Streams without their transport: a feed is asked for its next messages whenever the transport has room for them, so
// that what is held for a slow reader is bounded and one write at a time is in flight.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "google/protobuf/message.h"

namespace orbitune {

// A message for however many watchers, and its JSON, made once when it is first asked for. Thread-safe.
class StreamMessage {
 public:
  struct About {
    std::int64_t resume_after_seq = 0;  // a stream asked for with it goes on behind this message
    std::string_view kind;              // which event it is: "snapshot", "iteration", ... (a literal)
    bool last = false;                  // nothing will follow it
  };

  StreamMessage(About about, std::unique_ptr<const google::protobuf::Message> message)
      : about_(about), message_(std::move(message)) {}

  const About& about() const { return about_; }
  const google::protobuf::Message& message() const { return *message_; }
  const std::string& json() const;  // one line, without its end

 private:
  const About about_;
  const std::unique_ptr<const google::protobuf::Message> message_;
  mutable std::once_flag once_;
  mutable std::string json_;
};

using FeedItem = std::shared_ptr<const StreamMessage>;

// Thread-safe. Held by its transport; ends with it.
class Feed : public std::enable_shared_from_this<Feed> {
 public:
  // Either items, at least one, or the stream's end.
  struct Batch {
    std::vector<FeedItem> items;
    std::optional<absl::Status> end;
  };
  using Taken = std::function<void(Batch)>;

  virtual ~Feed() = default;

  // Hands over what comes next, at most `limit` items, as soon as there is something: from within the call or from
  // another thread. Not to be called again before it has; after the end it gives the end again.
  virtual void Next(std::size_t limit, Taken taken) = 0;

  // Ends the stream with `status`, unless it has ended. A Next under way is answered with it.
  virtual void End(const absl::Status& status) = 0;
};

// A stream that has ended before it began.
std::shared_ptr<Feed> EndedFeed(absl::Status status);

// The feeds of a server, so that a drain can end them. Thread-safe.
class Feeds {
 public:
  // Once drained, ends it at once.
  void Add(const std::shared_ptr<Feed>& feed);
  void Remove(const Feed* feed);

  // Ends every feed with UNAVAILABLE, and every later one at once.
  void Drain();

 private:
  std::mutex mutex_;
  // Guarded by mutex_.
  std::map<const Feed*, std::weak_ptr<Feed>> feeds_;
  bool drained_ = false;
};

}  // namespace orbitune
