#include "server/api/verify_feed.h"

#include <chrono>
#include <utility>

#include "core/base/check.h"
#include "server/convert/orbit.h"
#include "server/convert/provenance.h"

namespace orbitune {
namespace {

constexpr std::chrono::milliseconds kProgressPeriod{250};

// Everything is decided under mutex_; the verification runs in a task of its own, which ends soon after the feed.
class VerifyFeed final : public Feed {
 public:
  VerifyFeed(const v1::VerifyJobRequest& request, std::string client, const JobFeedContext& context)
      : request_(request), client_(std::move(client)), context_(context) {}
  ~VerifyFeed() override { context_.feeds.Remove(this); }

  void Next(std::size_t limit, Taken taken) override {
    std::unique_lock lock(mutex_);
    ORBITUNE_CHECK(taken_ == nullptr && limit > 0);
    taken_ = std::move(taken);
    if (!std::exchange(begun_, true) && !end_) {
      absl::Status posted =
          context_.executors.For(Work::kVerify)
              .TryPost(client_, [self = std::static_pointer_cast<VerifyFeed>(shared_from_this())] { self->Verify(); });
      if (!posted.ok()) end_ = std::move(posted);
    }
    Step(std::move(lock));
  }

  void End(const absl::Status& status) override {
    std::unique_lock lock(mutex_);
    if (end_) return;
    end_ = status;
    Step(std::move(lock));
  }

 private:
  void Verify() {
    const auto id = IdFromName("jobs", request_.name(), "name");
    if (!id.ok()) return End(id.status());
    const auto result = VerifyJob(context_.use_cases.store(), *id,
                                  {.first = request_.first_iteration(), .last = request_.last_iteration()},
                                  [this](const VerifyProgress& progress) { return Observe(progress); });
    if (!result.ok()) return End(result.status());
    std::unique_lock lock(mutex_);
    auto message = std::make_unique<v1::VerifyJobResponse>();
    ToProto(*result, message->mutable_verification());
    next_ = {.about = {.resume_after_seq = 0, .kind = "verification", .last = true}, .message = std::move(message)};
    Step(std::move(lock));
  }

  // False: nobody listens any more.
  bool Observe(const VerifyProgress& progress) {
    std::unique_lock lock(mutex_);
    if (end_) return false;
    const auto now = std::chrono::steady_clock::now();
    if (now - told_ < kProgressPeriod) return true;
    told_ = now;
    auto message = std::make_unique<v1::VerifyJobResponse>();
    ToProto(progress, message->mutable_progress());
    next_ = {.about = {.resume_after_seq = 0, .kind = "progress", .last = false}, .message = std::move(message)};
    Step(std::move(lock));
    return true;
  }

  // Answers Next if there is something to say. Gives the lock back.
  void Step(std::unique_lock<std::mutex> lock) {
    if (taken_ == nullptr || (!end_ && next_.message == nullptr)) return;
    Batch batch;
    if (end_) {
      batch.end = end_;
    } else {
      if (next_.about.last) end_ = absl::OkStatus();
      batch.parts.push_back(PartOf(std::exchange(next_, {})));
    }
    const Taken taken = std::exchange(taken_, nullptr);
    lock.unlock();
    taken(std::move(batch));
  }

  // Constant after construction.
  const v1::VerifyJobRequest request_;
  const std::string client_;
  const JobFeedContext context_;

  std::mutex mutex_;
  // Guarded by mutex_.
  Taken taken_;  // while Next is under way
  bool begun_ = false;
  StreamMessage next_;  // what is to be told: the newest progress, or the result; without a message: nothing
  std::chrono::steady_clock::time_point told_;
  std::optional<absl::Status> end_;
};

}  // namespace

std::shared_ptr<Feed> NewVerifyFeed(const v1::VerifyJobRequest& request, const Caller& caller,
                                    const JobFeedContext& context) {
  auto feed = std::make_shared<VerifyFeed>(request, caller.client(), context);
  context.feeds.Add(feed);
  return feed;
}

}  // namespace orbitune
