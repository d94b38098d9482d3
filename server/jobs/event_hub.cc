#include "server/jobs/event_hub.h"

#include <algorithm>
#include <atomic>
#include <utility>

namespace orbitune {

struct EventHub::Watcher {
  const Wake wake;
  const bool every;                 // it need not ask
  std::atomic<bool> asked = false;  // it is in the list, or about to be
  Watcher* next = nullptr;          // there
};

// What the watchers of a job look at without the hub's lock.
struct EventHub::News {
  std::atomic<std::uint64_t> publications = 0;
  std::atomic<Watcher*> asked = nullptr;  // a list

  void Add(Watcher& watcher) {
    watcher.next = asked;
    while (!asked.compare_exchange_weak(watcher.next, &watcher)) {
    }
  }
  // Calls `act` with each of the list, which is empty then.
  template <typename Act>
  void TakeAll(Act act) {
    for (Watcher* watcher = asked.exchange(nullptr); watcher != nullptr;) {
      Watcher* const next = watcher->next;
      act(*watcher);
      watcher = next;
    }
  }
};

std::uint64_t EventHub::Subscription::publications() const { return news_->publications; }

bool EventHub::Subscription::WakeAtNext(std::uint64_t seen) const {
  if (news_->publications != seen) return false;
  if (!watcher_->asked.exchange(true)) news_->Add(*watcher_);
  // A publication is counted before the list is taken: where it is not yet, we are in the list that it takes.
  return news_->publications == seen;
}

EventHub::Subscription::Subscription(Subscription&& other) noexcept { *this = std::move(other); }

EventHub::Subscription& EventHub::Subscription::operator=(Subscription&& other) noexcept {
  std::swap(hub_, other.hub_);
  std::swap(job_id_, other.job_id_);
  std::swap(news_, other.news_);
  std::swap(watcher_, other.watcher_);
  return *this;
}

EventHub::Subscription::~Subscription() {
  if (hub_ != nullptr) hub_->Remove(*this);
}

void EventHub::Publish(const std::string& job_id, JobEvent event) {
  auto shared = std::make_shared<const JobEvent>(std::move(event));
  if (observer_) observer_(job_id, *shared);
  const std::lock_guard lock(mutex_);
  Channel& channel = channels_[job_id];
  channel.recent.push_back(std::move(shared));
  if (channel.recent.size() > kept_per_job_) channel.recent.pop_front();
  if (channel.news == nullptr) return;
  ++channel.news->publications;
  // Under the lock, so that a subscription's end means that its wake function has returned.
  channel.news->TakeAll([&](Watcher& watcher) {
    if (watcher.every) {
      channel.news->Add(watcher);
    } else {
      watcher.asked = false;  // from here on it may be in the next list
    }
    watcher.wake();
  });
}

EventHub::Subscription EventHub::Subscribe(const std::string& job_id, Wake wake) {
  return Add(job_id, std::move(wake), true);
}

EventHub::Subscription EventHub::SubscribeOnDemand(const std::string& job_id, Wake wake) {
  return Add(job_id, std::move(wake), false);
}

EventHub::Subscription EventHub::Add(const std::string& job_id, Wake wake, bool every) {
  std::shared_ptr<Watcher> watcher(new Watcher{.wake = std::move(wake), .every = every, .asked = every});
  const std::lock_guard lock(mutex_);
  Channel& channel = channels_[job_id];
  ++channel.watchers;
  if (channel.news == nullptr) channel.news = std::make_shared<News>();
  if (every) channel.news->Add(*watcher);
  return {this, job_id, channel.news, std::move(watcher)};
}

void EventHub::Remove(const Subscription& subscription) {
  const std::lock_guard lock(mutex_);
  const auto channel = channels_.find(subscription.job_id_);
  if (subscription.watcher_->asked) {
    News& news = *subscription.news_;
    news.TakeAll([&](Watcher& watcher) {
      if (&watcher != subscription.watcher_.get()) news.Add(watcher);
    });
  }
  --channel->second.watchers;
  if (channel->second.IsIdle()) channels_.erase(channel);
}

EventHub::Recent EventHub::After(const std::string& job_id, std::int64_t after_seq, std::size_t limit) const {
  const std::lock_guard lock(mutex_);
  const auto channel = channels_.find(job_id);
  if (channel == channels_.end() || channel->second.recent.empty()) return {};
  const auto& recent = channel->second.recent;
  const std::int64_t first = recent.front()->seq;
  if (after_seq + 1 < first) return {};
  if (after_seq >= recent.back()->seq) return {.events = {}, .complete = true};
  const auto begin = recent.begin() + (after_seq + 1 - first);
  const auto count = std::min<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(limit), recent.end() - begin);
  return {.events = {begin, begin + count}, .complete = true};
}

std::int64_t EventHub::LastSeq(const std::string& job_id) const {
  const std::lock_guard lock(mutex_);
  const auto channel = channels_.find(job_id);
  return channel == channels_.end() || channel->second.recent.empty() ? 0 : channel->second.recent.back()->seq;
}

void EventHub::Forget(const std::string& job_id) {
  const std::lock_guard lock(mutex_);
  const auto channel = channels_.find(job_id);
  if (channel == channels_.end()) return;
  channel->second.recent.clear();
  if (channel->second.IsIdle()) channels_.erase(channel);
}

}  // namespace orbitune
