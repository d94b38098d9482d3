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
      feeds_.emplace(feed.get(), Open{feed, ""});
      return;
    }
  }
  feed->End(GoingDown());
}

void Feeds::Remove(const Feed* feed) {
  const std::lock_guard lock(mutex_);
  feeds_.erase(feed);
}

void Feeds::SetTokenOf(const Feed* feed, const std::string& token_id) {
  const std::lock_guard lock(mutex_);
  const auto found = feeds_.find(feed);
  if (found != feeds_.end()) found->second.token_id = token_id;
}

std::vector<std::shared_ptr<Feed>> Feeds::Those(const std::string* token_id) const {
  std::vector<std::shared_ptr<Feed>> those;
  for (const auto& [address, open] : feeds_) {
    if (token_id != nullptr && open.token_id != *token_id) continue;
    if (auto held = open.feed.lock()) those.push_back(std::move(held));
  }
  return those;
}

void Feeds::EndThoseOf(const std::string& token_id, const absl::Status& status) {
  std::vector<std::shared_ptr<Feed>> feeds;
  {
    const std::lock_guard lock(mutex_);
    feeds = Those(&token_id);
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
