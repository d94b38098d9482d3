#include "server/api/executor.h"

#include <sys/resource.h>

#include <utility>

namespace orbitune {

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
  }
  return reads_;
}

void AddNice(int nice) {
  if (nice != 0) setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + nice);  // in Linux of the thread alone
}

Executor::Executor(int threads, std::size_t most_queued, int nice) : most_queued_(most_queued) {
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

void Executor::Post(std::function<void()> task) {
  {
    const std::lock_guard lock(mutex_);
    tasks_.push_back(std::move(task));
  }
  ready_.notify_one();
}

bool Executor::TryPost(std::function<void()> task) {
  {
    const std::lock_guard lock(mutex_);
    if (tasks_.size() >= most_queued_) return false;
    tasks_.push_back(std::move(task));
  }
  ready_.notify_one();
  return true;
}

void Executor::Loop(int nice) {
  AddNice(nice);
  std::unique_lock lock(mutex_);
  while (true) {
    ready_.wait(lock, [this] { return ending_ || !tasks_.empty(); });
    if (tasks_.empty()) return;
    const std::function<void()> task = std::move(tasks_.front());
    tasks_.pop_front();
    lock.unlock();
    task();
    lock.lock();
  }
}

}  // namespace orbitune
