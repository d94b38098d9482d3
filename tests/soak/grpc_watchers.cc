#include "tests/soak/grpc_watchers.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "orbitune/v1/tuning.grpc.pb.h"

namespace orbitune::soak {

// Reads while it is not stalled; one call at a time. A new one is begun by a thread of its own, some time after the
// last one ended.
class GrpcWatchers::Watcher : public grpc::ClientReadReactor<v1::WatchJobResponse> {
 public:
  Watcher(std::shared_ptr<grpc::Channel> channel, WatchedJob& job, bool every, int number, Journal& journal)
      : stub_(v1::TuningService::NewStub(channel)),
        job_(job),
        every_(every),
        in_batches_(every && number % 3 == 0),
        journal_(journal),
        check_((every ? "gRPC watcher " : "gRPC watcher of the latest ") + std::to_string(number)) {}

  void Begin() {
    context_ = std::make_unique<grpc::ClientContext>();
    request_.set_name(job_.name);
    request_.set_resume_after_seq(check_.last());
    request_.set_delivery(every_ ? v1::DELIVERY_EVERY : v1::DELIVERY_LATEST);
    request_.set_max_iterations_per_message(in_batches_ ? 256 : 0);
    stub_->async()->WatchJob(context_.get(), &request_, this);
    AddHold();
    StartRead(&response_);
    StartCall();
  }

  void OnReadDone(bool ok) override {
    if (!ok) return RemoveHold();
    Take();
    {
      const std::lock_guard lock(mutex_);
      if (stalled_) {
        waiting_ = true;
        return;
      }
    }
    StartRead(&response_);
  }

  void OnDone(const grpc::Status& status) override {
    const grpc::StatusCode code = status.error_code();
    if (code == grpc::StatusCode::RESOURCE_EXHAUSTED ||
        (code == grpc::StatusCode::UNAVAILABLE && journal_.restarting)) {
      journal_.Refusal();
    } else if (!journal_.stopping) {
      journal_.Fault("a gRPC watcher ended: " + std::to_string(code) + " " + status.error_message());
    }
    const std::lock_guard lock(mutex_);
    ended_ = true;
    changed_.notify_all();
  }

  // Begins again what has ended; false: it goes on.
  bool Revive() {
    {
      const std::lock_guard lock(mutex_);
      if (!ended_) return false;
      ended_ = false;
    }
    Begin();
    return true;
  }

  void SetStalled(bool stalled) {
    {
      const std::lock_guard lock(mutex_);
      stalled_ = stalled;
      if (stalled || !waiting_) return;
      waiting_ = false;
    }
    StartRead(&response_);
  }

  void Cancel() {
    SetStalled(false);
    context_->TryCancel();
  }

  void AwaitEnd() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return ended_; });
  }

 private:
  void Take() {
    if (response_.has_snapshot()) return;
    const int events = std::max(1, response_.iteration_batch().iterations_size());
    journal_.grpc_events += events;
    const std::int64_t seq = response_.seq();
    check_.Take(response_.has_gap() ? response_.gap().first_seq() : seq - events + 1, seq, journal_);
    if (response_.has_gap()) return;
    const double behind_s = job_.first_seen.Note(seq, Clock::now());
    const std::lock_guard lock(mutex_);
    if (behind_s > 0 && !ever_stalled_) journal_.behind_first.Note(behind_s);
    ever_stalled_ = ever_stalled_ || stalled_;
  }

  const std::unique_ptr<v1::TuningService::Stub> stub_;
  WatchedJob& job_;
  const bool every_;
  const bool in_batches_;
  Journal& journal_;
  SequenceCheck check_;
  v1::WatchJobRequest request_;
  v1::WatchJobResponse response_;
  std::unique_ptr<grpc::ClientContext> context_;

  std::mutex mutex_;
  std::condition_variable changed_;
  // Guarded by mutex_.
  bool stalled_ = false;
  bool ever_stalled_ = false;
  bool waiting_ = false;  // for the end of the stall, with no read under way
  bool ended_ = false;
};

GrpcWatchers::GrpcWatchers(const std::string& address, int count, std::vector<std::unique_ptr<WatchedJob>>& jobs,
                           Journal& journal) {
  constexpr int kOfAChannel = 50;
  std::shared_ptr<grpc::Channel> channel;
  for (int i = 0; i < count; ++i) {
    if (i % kOfAChannel == 0) {
      grpc::ChannelArguments arguments;
      arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
      arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 500);
      channel = grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
    }
    auto& job = *jobs[static_cast<std::size_t>(i) % jobs.size()];
    watchers_.push_back(std::make_shared<Watcher>(channel, job, i % 2 == 0, i, journal));
    watchers_.back()->Begin();
  }
}

GrpcWatchers::~GrpcWatchers() = default;

void GrpcWatchers::Stall(int count) {
  for (int i = 0; i < count; ++i) watchers_[static_cast<std::size_t>(i)]->SetStalled(true);
}

void GrpcWatchers::GoOn() {
  for (const auto& watcher : watchers_) watcher->SetStalled(false);
  for (const auto& watcher : watchers_) watcher->Revive();
}

void GrpcWatchers::Stop() {
  for (const auto& watcher : watchers_) watcher->Cancel();
  for (const auto& watcher : watchers_) watcher->AwaitEnd();
}

}  // namespace orbitune::soak
