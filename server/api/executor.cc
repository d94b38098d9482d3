#include "server/api/executor.h"

#include <algorithm>
#include <utility>

#include "core/base/nice.h"

namespace orbitune {
namespace {

Executor::Limits LimitsOf(const ExecutorLimits& limits) {
  return {.waiting = {"max-calls-waiting", limits.max_calls_waiting},
          .waiting_per_client = {"max-calls-waiting-per-client", limits.max_calls_waiting_per_client}};
}

}  // namespace

Executors::Executors(const ExecutorLimits& limits)
    : reads_(4, LimitsOf(limits)),
      writes_(4, LimitsOf(limits)),
      queries_(2, LimitsOf(limits)),
      episodes_(limits.max_episode_calls, LimitsOf(limits), kFlightNice),
      streams_(2, LimitsOf(limits), kStreamNice),
      crowd_(2, LimitsOf(limits), kCrowdNice),
      verifications_(limits.max_verifications, LimitsOf(limits), kVerifyNice) {}

Executor& Executors::For(Work work) {
  switch (work) {
    case Work::kRead:
      return reads_;
    case Work::kWrite:
      return writes_;
    case Work::kQuery:
      return queries_;
    case Work::kEpisode:
      return episodes_;
    case Work::kStream:
      return streams_;
    case Work::kCrowd:
      return crowd_;
    case Work::kVerify:
      return verifications_;
  }
  return reads_;
}

Executor::Executor(int threads, Limits limits, int nice) : threads_count_(threads), limits_(std::move(limits)) {
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this, nice] { Loop(nice); });
}

Executor::~Executor() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  ready_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

// Under mutex_.
void Executor::Put(Clients::iterator client, std::function<void()> task) {
  if (client->second.tasks.empty()) turns_.push_back(client);
  client->second.tasks.push_back(std::move(task));
  ++waiting_;
}

void Executor::Post(std::function<void()> task) {
  {
    const std::lock_guard lock(mutex_);
    Put(clients_.try_emplace("").first, std::move(task));
  }
  ready_.notify_one();
}

absl::Status Executor::TryPost(const std::string& client, std::function<void()> task) {
  {
    const std::lock_guard lock(mutex_);
    constexpr std::string_view kLater = "try again when some have been answered";
    if (std::cmp_greater_equal(waiting_, limits_.waiting.value)) {
      return LimitExceeded("calls waiting for their turn", limits_.waiting, kLater);
    }
    const auto found = clients_.find(client);
    if (found != clients_.end() &&
        std::cmp_greater_equal(found->second.tasks.size(), limits_.waiting_per_client.value)) {
      return LimitExceeded("calls of one client waiting for their turn", limits_.waiting_per_client, kLater);
    }
    Put(clients_.try_emplace(client).first, std::move(task));
  }
  ready_.notify_one();
  return absl::OkStatus();
}

std::size_t Executor::waiting() {
  const std::lock_guard lock(mutex_);
  return waiting_;
}

// Under mutex_: whose turn it is; the end where nobody may be served. One thread is always left for others, but for
// the server's own tasks.
std::deque<Executor::Clients::iterator>::iterator Executor::Next() {
  const int most = std::max(1, threads_count_ - 1);
  return std::ranges::find_if(
      turns_, [most](const auto& client) { return client->first.empty() || client->second.running < most; });
}

void Executor::Loop(int nice) {
  AddNice(nice);
  std::unique_lock lock(mutex_);
  while (true) {
    auto next = turns_.end();
    // A client that has as many threads as it may is served on by one of those.
    ready_.wait(lock, [&] { return (next = Next()) != turns_.end() || (ending_ && turns_.empty()); });
    if (next == turns_.end()) return;
    const Clients::iterator client = *next;
    turns_.erase(next);
    std::function<void()> task = std::move(client->second.tasks.front());
    client->second.tasks.pop_front();
    --waiting_;
    ++client->second.running;
    if (!client->second.tasks.empty()) turns_.push_back(client);
    lock.unlock();
    task();
    task = nullptr;  // what it holds may take its time to go
    lock.lock();
    if (--client->second.running == 0 && client->second.tasks.empty()) clients_.erase(client);
    if (ending_ && turns_.empty()) ready_.notify_all();
  }
}

}  // namespace orbitune
