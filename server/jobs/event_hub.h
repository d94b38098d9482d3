// Carries committed events from the store's writer to whoever watches a job. Recent events are kept in memory, older
// ones are the store's: a watcher that lags reads them there, and delays nobody.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "storage/job.h"

namespace orbitune {

// Thread-safe.
class EventHub {
 public:
  using Event = std::shared_ptr<const JobEvent>;
  // Called on the publisher's thread; must not block nor call the hub back.
  using Wake = std::function<void()>;

  // Ends with the object: after its destruction the wake function is not called any more, nor running.
  class Subscription {
   public:
    Subscription() = default;
    Subscription(Subscription&& other) noexcept;
    Subscription& operator=(Subscription&& other) noexcept;
    ~Subscription();

    // How many there have been for the job since somebody subscribed to it.
    std::uint64_t publications() const { return *publications_; }

   private:
    friend class EventHub;
    using Count = std::shared_ptr<const std::atomic<std::uint64_t>>;
    Subscription(EventHub* hub, std::string job_id, std::uint64_t key, Count publications)
        : hub_(hub), job_id_(std::move(job_id)), key_(key), publications_(std::move(publications)) {}
    EventHub* hub_ = nullptr;
    std::string job_id_;
    std::uint64_t key_ = 0;
    Count publications_;
  };

  static constexpr std::size_t kKeptPerJob = 256;

  explicit EventHub(std::size_t kept_per_job = kKeptPerJob) : kept_per_job_(kept_per_job) {}

  // Called with every event published, before its watchers are woken, on the publisher's thread. Set while nothing is
  // published. An empty one: nobody.
  using Observer = std::function<void(const std::string& job_id, const JobEvent& event)>;
  void SetObserver(Observer observer) { observer_ = std::move(observer); }

  // In the order of seq, for each job.
  void Publish(const std::string& job_id, JobEvent event);

  // Woken after each publication.
  Subscription Subscribe(const std::string& job_id, Wake wake);

  // Woken when it has asked to be, so that a publication costs nothing for whoever is busy with those before it.
  Subscription SubscribeOnDemand(const std::string& job_id, Wake wake);

  // Wakes the subscription, made on demand, after the next publication, once. False where there have been others than
  // the `seen` first ones: it is not woken then.
  bool WakeAtNext(const Subscription& subscription, std::uint64_t seen);

  struct Recent {
    std::vector<Event> events;  // in order, from after_seq + 1 on, dense
    bool complete = false;      // what is not in `events`, but for the limit, has not happened yet
  };
  // The kept events after `after_seq`, at most `limit`. Not complete where the next one may be the store's alone.
  Recent After(const std::string& job_id, std::int64_t after_seq, std::size_t limit) const;

  // Of the newest event kept; 0: none is.
  std::int64_t LastSeq(const std::string& job_id) const;

  // Lets go of a job's kept events; publications go on reaching its watchers.
  void Forget(const std::string& job_id);

 private:
  struct Channel {
    std::deque<Event> recent;  // dense in seq
    const std::shared_ptr<std::atomic<std::uint64_t>> publications = std::make_shared<std::atomic<std::uint64_t>>(0);
    std::map<std::uint64_t, Wake> watchers;   // of every publication
    std::map<std::uint64_t, Wake> on_demand;  // those who have to ask
    std::set<std::uint64_t> asked;            // of them

    bool IsIdle() const { return recent.empty() && watchers.empty() && on_demand.empty(); }
  };

  Subscription Add(const std::string& job_id, std::map<std::uint64_t, Wake> Channel::*to, Wake wake);
  void Unsubscribe(const std::string& job_id, std::uint64_t key);

  const std::size_t kept_per_job_;
  Observer observer_;

  mutable std::mutex mutex_;
  // Guarded by mutex_.
  std::map<std::string, Channel> channels_;
  std::uint64_t next_key_ = 0;
};

}  // namespace orbitune
