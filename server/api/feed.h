// Streams without their transport: a feed is asked for its next messages whenever the transport has room for them, so
// that what is held for a slow reader is bounded and one write at a time is in flight.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "google/protobuf/message.h"

namespace orbitune {

// A message for however many watchers.
struct StreamMessage {
  struct About {
    std::int64_t resume_after_seq = 0;  // a stream asked for with it goes on behind this message
    std::string_view kind;              // which event it is: "snapshot", "iteration", ... (a literal)
    bool last = false;                  // nothing will follow it
    std::size_t events = 1;             // that it tells
  };
  About about;
  std::unique_ptr<const google::protobuf::Message> message;
};

using FeedItem = std::shared_ptr<const StreamMessage>;

// Messages that follow one another, and their text, made once when it is first asked for. Thread-safe.
class StreamRun {
 public:
  explicit StreamRun(std::vector<FeedItem> items) : items_(std::move(items)) {}

  const std::vector<FeedItem>& items() const { return items_; }

  // Of items [begin, end), as text/event-stream has them.
  std::string_view Events(std::size_t begin, std::size_t end) const;
  // The JSON of one, a line without its end.
  std::string_view Line(std::size_t item) const;

 private:
  struct Place {
    std::size_t json = 0;
    std::size_t end = 0;
  };

  void Write() const;

  const std::vector<FeedItem> items_;
  mutable std::once_flag once_;
  mutable std::string text_;
  mutable std::vector<Place> places_;
};

// Items [begin, end) of a run: watchers that are at the same place share it.
struct StreamPart {
  std::shared_ptr<const StreamRun> run;
  std::size_t begin = 0;
  std::size_t end = 0;

  std::size_t size() const { return end - begin; }
  const FeedItem& front() const { return run->items()[begin]; }
  const FeedItem& back() const { return run->items()[end - 1]; }
};

StreamPart PartOf(StreamMessage message);

// Takes the first `limit` items, or what there is, from the parts.
std::vector<StreamPart> TakeFront(std::deque<StreamPart>& parts, std::size_t limit);

// Thread-safe. Held by its transport; ends with it.
class Feed : public std::enable_shared_from_this<Feed> {
 public:
  // Either items, at least one, or the stream's end.
  struct Batch {
    std::vector<StreamPart> parts;
    std::optional<absl::Status> end;
  };
  using Taken = std::function<void(Batch)>;

  virtual ~Feed() = default;

  // Hands over what comes next, at most `limit` items, as soon as there is something: from within the call or from
  // another thread. Not to be called again before it has; after the end it gives the end again.
  virtual void Next(std::size_t limit, Taken taken) = 0;

  // Ends the stream with `status`, unless it has ended. A Next under way is answered with it.
  virtual void End(const absl::Status& status) = 0;

  // Events that there are and that have not been handed over.
  virtual std::int64_t lag() { return 0; }
};

// What whoever asks a drained server for something is told.
absl::Status GoingDown();

// A stream that has ended before it began.
std::shared_ptr<Feed> EndedFeed(absl::Status status);

// Whose a feed is.
struct FeedOwner {
  std::string client;          // with whom it shares limits
  std::string credential_id;   // with which it was opened; empty: without
  std::string_view transport;  // a literal
};

// The feeds of a server: how many there may be, and so that a drain can end them. Thread-safe.
class Feeds {
 public:
  struct Limits {
    int max_watchers = 4096;
    int max_watchers_per_client = 2048;
  };

  explicit Feeds(const Limits& limits) : limits_(limits) {}

  // Once drained, ends it at once.
  void Add(const std::shared_ptr<Feed>& feed);
  void Remove(const Feed* feed);

  // A feed that `open` makes; RESOURCE_EXHAUSTED with the limit where its owner may have no more.
  absl::StatusOr<std::shared_ptr<Feed>> Open(FeedOwner owner, const std::function<std::shared_ptr<Feed>()>& open);

  void EndThoseOf(const std::string& credential_id, const absl::Status& status);

  // Ends every feed with UNAVAILABLE, and every later one at once.
  void Drain();

  struct Counts {
    std::map<std::string_view, int> by_transport;
    std::int64_t largest_lag = 0;
    int behind = 0;  // those that have more to take than what is kept in memory for all
  };
  Counts Count();

 private:
  struct Held {
    std::weak_ptr<Feed> feed;
    FeedOwner owner;
  };

  absl::Status Reserve(const std::string& client);
  void Release(const std::string& client);  // under mutex_

  std::vector<std::shared_ptr<Feed>> Those(const std::string* credential_id) const;  // under mutex_; nullptr: all

  const Limits limits_;

  std::mutex mutex_;
  // Guarded by mutex_.
  std::map<const Feed*, Held> feeds_;
  std::map<std::string, int> watchers_;  // by client; some may be about to be opened
  int all_watchers_ = 0;
  bool drained_ = false;
};

}  // namespace orbitune
