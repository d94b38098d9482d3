// Carries committed events from the store's writer to whoever watches a job. Recent events are kept in memory, older
// ones are the store's: a watcher that lags reads them there, and delays nobody.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
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

  struct Watcher;
  struct News;

  // Ends with the object: after its destruction the wake function is not called any more, nor running.
  class Subscription {
   public:
    Subscription() = default;
    Subscription(Subscription&& other) noexcept;
    Subscription& operator=(Subscription&& other) noexcept;
    ~Subscription();

    // How many there have been for the job since somebody subscribed to it.
    std::uint64_t publications() const;

    // Of one made on demand: wakes it after the next publication, once. False where there have been others than the
    // `seen` first ones; it may then be woken all the same. Takes no lock: whoever asks may have a low priority, and be
    // kept from going on for long.
    bool WakeAtNext(std::uint64_t seen) const;

   private:
    friend class EventHub;
    Subscription(EventHub* hub, std::string job_id, std::shared_ptr<News> news, std::shared_ptr<Watcher> watcher)
        : hub_(hub), job_id_(std::move(job_id)), news_(std::move(news)), watcher_(std::move(watcher)) {}
    EventHub* hub_ = nullptr;
    std::string job_id_;
    std::shared_ptr<News> news_;
    std::shared_ptr<Watcher> watcher_;
  };

  // As far as a job may be ahead of the disk: what one commit publishes of it is there for who is woken by it.
  static constexpr std::size_t kKeptPerJob = 512;

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
    int watchers = 0;
    std::shared_ptr<News> news;  // where there are watchers, or were

    bool IsIdle() const { return recent.empty() && watchers == 0; }
  };

  Subscription Add(const std::string& job_id, Wake wake, bool every);
  void Remove(const Subscription& subscription);

  const std::size_t kept_per_job_;
  Observer observer_;

  mutable std::mutex mutex_;
  // Guarded by mutex_.
  std::map<std::string, Channel> channels_;
};

}  // namespace orbitune
