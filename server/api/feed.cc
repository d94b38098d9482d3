#include "server/api/feed.h"

#include "server/api/json.h"

namespace orbitune {
namespace {

absl::Status GoingDown() { return absl::UnavailableError("the server is going down"); }

class Ended final : public Feed {
 public:
  explicit Ended(absl::Status status) : status_(std::move(status)) {}
  void Next(std::size_t, Taken taken) override { taken({.items = {}, .end = status_}); }
  void End(const absl::Status&) override {}

 private:
  const absl::Status status_;
};

}  // namespace

std::shared_ptr<Feed> EndedFeed(absl::Status status) { return std::make_shared<Ended>(std::move(status)); }

const std::string& StreamMessage::json() const {
  std::call_once(once_, [this] { json_ = ToJson(*message_); });
  return json_;
}

void Feeds::Add(const std::shared_ptr<Feed>& feed) {
  {
    const std::lock_guard lock(mutex_);
    if (!drained_) {
      feeds_.emplace(feed.get(), feed);
      return;
    }
  }
  feed->End(GoingDown());
}

void Feeds::Remove(const Feed* feed) {
  const std::lock_guard lock(mutex_);
  feeds_.erase(feed);
}

void Feeds::Drain() {
  std::vector<std::shared_ptr<Feed>> feeds;
  {
    const std::lock_guard lock(mutex_);
    drained_ = true;
    for (const auto& [address, feed] : feeds_) {
      if (auto held = feed.lock()) feeds.push_back(std::move(held));
    }
  }
  for (const auto& feed : feeds) feed->End(GoingDown());
}

}  // namespace orbitune
