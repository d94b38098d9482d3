#include "server/api/feed.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "core/base/status.h"
#include "server/api/json.h"
#include "server/jobs/event_hub.h"
#include "server/jobs/limit.h"

namespace orbitune {
namespace {

class Ended final : public Feed {
 public:
  explicit Ended(absl::Status status) : status_(std::move(status)) {}
  void Next(std::size_t, Taken taken) override { taken({.parts = {}, .end = status_}); }
  void End(const absl::Status&) override {}

 private:
  const absl::Status status_;
};

}  // namespace

std::string_view StreamRun::Events(std::size_t begin, std::size_t end) const {
  std::call_once(once_, [this] { Write(); });
  const std::size_t from = begin == 0 ? 0 : places_[begin - 1].end;
  return std::string_view(text_).substr(from, places_[end - 1].end - from);
}

std::string_view StreamRun::Line(std::size_t item) const {
  std::call_once(once_, [this] { Write(); });
  return std::string_view(text_).substr(places_[item].json, places_[item].end - 2 - places_[item].json);
}

void StreamRun::Write() const {
  for (const FeedItem& item : items_) {
    absl::StrAppend(&text_, "id: ", item->about.resume_after_seq, "\nevent: ", ToAbsl(item->about.kind), "\ndata: ");
    const std::size_t json = text_.size();
    absl::StrAppend(&text_, ToJson(*item->message), "\n\n");
    places_.push_back({.json = json, .end = text_.size()});
  }
  text_.shrink_to_fit();
}

StreamPart PartOf(StreamMessage message) {
  std::vector<FeedItem> items;
  items.push_back(std::make_shared<const StreamMessage>(std::move(message)));
  return {.run = std::make_shared<const StreamRun>(std::move(items)), .begin = 0, .end = 1};
}

std::vector<StreamPart> TakeFront(std::deque<StreamPart>& parts, std::size_t limit) {
  std::vector<StreamPart> taken;
  while (limit > 0 && !parts.empty()) {
    StreamPart& front = parts.front();
    const std::size_t count = std::min(limit, front.size());
    limit -= count;
    taken.push_back({.run = front.run, .begin = front.begin, .end = front.begin + count});
    front.begin += count;
    if (front.size() == 0) parts.pop_front();
  }
  return taken;
}

absl::Status GoingDown() { return absl::UnavailableError("the server is going down"); }

std::shared_ptr<Feed> EndedFeed(absl::Status status) { return std::make_shared<Ended>(std::move(status)); }

void Feeds::Add(const std::shared_ptr<Feed>& feed) {
  {
    const std::lock_guard lock(mutex_);
    if (!drained_) {
      feeds_.emplace(feed.get(), Held{feed, {}});
      return;
    }
  }
  feed->End(GoingDown());
}

void Feeds::Remove(const Feed* feed) {
  const std::lock_guard lock(mutex_);
  const auto found = feeds_.find(feed);
  if (found == feeds_.end()) return;
  if (!found->second.owner.client.empty()) Release(found->second.owner.client);
  feeds_.erase(found);
}

absl::Status Feeds::Reserve(const std::string& client) {
  constexpr std::string_view kLater = "try again when another watcher has gone";
  const std::lock_guard lock(mutex_);
  if (all_watchers_ >= limits_.max_watchers) {
    return LimitExceeded("watchers", {"max-watchers", limits_.max_watchers}, kLater);
  }
  int& of_client = watchers_[client];
  if (of_client >= limits_.max_watchers_per_client) {
    return LimitExceeded("watchers of one client", {"max-watchers-per-client", limits_.max_watchers_per_client},
                         kLater);
  }
  ++of_client;
  ++all_watchers_;
  return absl::OkStatus();
}

void Feeds::Release(const std::string& client) {
  --all_watchers_;
  const auto found = watchers_.find(client);
  if (--found->second == 0) watchers_.erase(found);
}

absl::StatusOr<std::shared_ptr<Feed>> Feeds::Open(FeedOwner owner, const std::function<std::shared_ptr<Feed>()>& open) {
  if (owner.client.empty()) owner.client = "unknown";
  if (absl::Status status = Reserve(owner.client); !status.ok()) return status;
  auto feed = open();
  const std::lock_guard lock(mutex_);
  const auto found = feeds_.find(feed.get());
  if (found != feeds_.end()) {
    found->second.owner = std::move(owner);
  } else {
    Release(owner.client);
  }
  return feed;
}

Feeds::Counts Feeds::Count() {
  Counts counts;
  std::vector<std::shared_ptr<Feed>> feeds;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [address, held] : feeds_) ++counts.by_transport[held.owner.transport];
    feeds = Those(nullptr);
  }
  for (const auto& feed : feeds) {
    const std::int64_t lag = feed->lag();
    counts.largest_lag = std::max(counts.largest_lag, lag);
    counts.behind += std::cmp_greater(lag, EventHub::kKeptPerJob);
  }
  return counts;
}

std::vector<std::shared_ptr<Feed>> Feeds::Those(const std::string* credential_id) const {
  std::vector<std::shared_ptr<Feed>> those;
  for (const auto& [address, held] : feeds_) {
    if (credential_id != nullptr && held.owner.credential_id != *credential_id) continue;
    if (auto feed = held.feed.lock()) those.push_back(std::move(feed));
  }
  return those;
}

void Feeds::EndThoseOf(const std::string& credential_id, const absl::Status& status) {
  std::vector<std::shared_ptr<Feed>> feeds;
  {
    const std::lock_guard lock(mutex_);
    feeds = Those(&credential_id);
  }
  for (const auto& feed : feeds) feed->End(status);
}

void Feeds::Drain() {
  std::vector<std::shared_ptr<Feed>> feeds;
  {
    const std::lock_guard lock(mutex_);
    drained_ = true;
    feeds = Those(nullptr);
  }
  for (const auto& feed : feeds) feed->End(GoingDown());
}

}  // namespace orbitune
