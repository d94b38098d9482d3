#include "server/jobs/event_hub.h"

#include <algorithm>
#include <utility>

namespace orbitune {

EventHub::Subscription::Subscription(Subscription&& other) noexcept { *this = std::move(other); }

EventHub::Subscription& EventHub::Subscription::operator=(Subscription&& other) noexcept {
  std::swap(hub_, other.hub_);
  std::swap(job_id_, other.job_id_);
  std::swap(key_, other.key_);
  std::swap(publications_, other.publications_);
  return *this;
}

EventHub::Subscription::~Subscription() {
  if (hub_ != nullptr) hub_->Unsubscribe(job_id_, key_);
}

void EventHub::Publish(const std::string& job_id, JobEvent event) {
  auto shared = std::make_shared<const JobEvent>(std::move(event));
  if (observer_) observer_(job_id, *shared);
  const std::lock_guard lock(mutex_);
  Channel& channel = channels_[job_id];
  channel.recent.push_back(std::move(shared));
  if (channel.recent.size() > kept_per_job_) channel.recent.pop_front();
  ++*channel.publications;
  // Under the lock, so that a subscription's end means that its wake function has returned.
  for (const auto& [key, wake] : channel.watchers) wake();
  for (const std::uint64_t key : std::exchange(channel.asked, {})) channel.on_demand.at(key)();
}

EventHub::Subscription EventHub::Subscribe(const std::string& job_id, Wake wake) {
  return Add(job_id, &Channel::watchers, std::move(wake));
}

EventHub::Subscription EventHub::SubscribeOnDemand(const std::string& job_id, Wake wake) {
  return Add(job_id, &Channel::on_demand, std::move(wake));
}

EventHub::Subscription EventHub::Add(const std::string& job_id, std::map<std::uint64_t, Wake> Channel::*to, Wake wake) {
  const std::lock_guard lock(mutex_);
  const std::uint64_t key = ++next_key_;
  Channel& channel = channels_[job_id];
  (channel.*to).emplace(key, std::move(wake));
  return {this, job_id, key, channel.publications};
}

bool EventHub::WakeAtNext(const Subscription& subscription, std::uint64_t seen) {
  const std::lock_guard lock(mutex_);
  Channel& channel = channels_.at(subscription.job_id_);
  if (*channel.publications != seen) return false;
  channel.asked.insert(subscription.key_);
  return true;
}

void EventHub::Unsubscribe(const std::string& job_id, std::uint64_t key) {
  const std::lock_guard lock(mutex_);
  const auto channel = channels_.find(job_id);
  if (channel == channels_.end()) return;
  channel->second.watchers.erase(key);
  channel->second.on_demand.erase(key);
  channel->second.asked.erase(key);
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
