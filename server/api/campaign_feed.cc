#include "server/api/campaign_feed.h"

#include <algorithm>
#include <atomic>
#include <deque>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"

namespace orbitune {
namespace {

constexpr int kPage = 100;  // events taken at a time

// Idle, or reading the store on the executor: `reading_` tells. All is decided under mutex_.
class CampaignFeed final : public Feed {
 public:
  CampaignFeed(const v1::WatchCampaignRequest& request, const CampaignFeedContext& context)
      : request_(request), context_(context) {}
  ~CampaignFeed() override { context_.feeds.Remove(this); }

  void Next(std::size_t limit, Taken taken) override {
    std::unique_lock lock(mutex_);
    ORBITUNE_CHECK(taken_ == nullptr && limit > 0);
    limit_ = limit;
    taken_ = std::move(taken);
    Step(std::move(lock));
  }

  void End(const absl::Status& status) override { EndWith(std::unique_lock(mutex_), status); }

 private:
  // On the executor: the snapshot the first time, then what is new.
  void Read() {
    absl::Status status = id_.empty() ? Open() : ReadNews();
    std::unique_lock lock(mutex_);
    reading_ = false;
    if (!status.ok()) return EndWith(std::move(lock), status);
    Step(std::move(lock));
  }

  // Reads belong to one task at a time; what Step sees of them is set under the lock.
  absl::Status Open() {
    const auto id = IdFromName("campaigns", request_.name(), "name");
    if (!id.ok()) return id.status();
    // Before the snapshot is read: what is committed after it then wakes us.
    auto subscription = context_.use_cases.engine().Subscribe(*id, [this] { Wake(); });
    const auto campaign = context_.use_cases.Get(*id);
    if (!campaign.ok()) return campaign.status();
    const std::int64_t asked = request_.resume_after_seq();
    if (asked < -1 || asked > campaign->last_seq) {
      return InvalidField("resume_after_seq", absl::StrCat("in [-1, ", campaign->last_seq, "], the campaign's last"),
                          static_cast<double>(asked));
    }
    const std::lock_guard lock(mutex_);
    if (end_) return absl::OkStatus();
    subscription_ = std::move(subscription);
    id_ = *id;
    read_seq_ = asked == -1 ? campaign->last_seq : asked;
    snapshot_seq_ = campaign->last_seq;
    ended_ = IsTerminal(campaign->state) && read_seq_ == campaign->last_seq;
    auto message = std::make_unique<v1::WatchCampaignResponse>();
    message->set_seq(campaign->last_seq);
    ToProto(*campaign, message->mutable_snapshot());
    progress_ = message->snapshot().progress().SerializeAsString();
    Put("snapshot", std::move(message));
    news_ = true;
    return absl::OkStatus();
  }

  absl::Status ReadNews() {
    const auto events = context_.use_cases.ListEvents(id_, read_seq_, kPage);
    if (!events.ok()) return events.status();
    const auto campaign = events->empty() ? context_.use_cases.Get(id_) : absl::StatusOr<CampaignRecord>();
    const std::lock_guard lock(mutex_);
    if (events->size() == static_cast<std::size_t>(kPage)) news_ = true;
    for (const CampaignEventView& event : *events) {
      auto message = std::make_unique<v1::WatchCampaignResponse>();
      ToProto(event, message.get());
      read_seq_ = event.event.seq;
      // One that an extension followed is no end.
      const auto* change = std::get_if<CampaignStateChange>(&event.event.what);
      ended_ = change != nullptr && IsTerminal(change->state) && read_seq_ >= snapshot_seq_;
      Put(event.member ? "member_ended" : "state_change", std::move(message));
    }
    return events->empty() ? PutProgress(campaign) : absl::OkStatus();
  }

  // Under the lock.
  absl::Status PutProgress(const absl::StatusOr<CampaignRecord>& campaign) {
    if (!campaign.ok()) return campaign.status();
    auto message = std::make_unique<v1::WatchCampaignResponse>();
    message->set_seq(read_seq_);
    ToProto(*campaign, message->mutable_progress());
    std::string progress = message->progress().SerializeAsString();
    if (progress == progress_) return absl::OkStatus();
    progress_ = std::move(progress);
    Put("progress", std::move(message));
    return absl::OkStatus();
  }

  // Under the lock.
  void Put(std::string_view kind, std::unique_ptr<v1::WatchCampaignResponse> message) {
    outbox_.push_back(PartOf({{read_seq_, kind, ended_}, std::move(message)}));
  }

  // From the engine, under its watchers' lock: nothing here may wait for mutex_, under which the engine is called.
  void Wake() {
    if (waking_.exchange(true)) return;
    // Not while the last holder is letting go.
    if (auto self = std::static_pointer_cast<CampaignFeed>(weak_from_this().lock())) {
      context_.executors.For(Work::kRead).Post([self = std::move(self)] { self->Woken(); });
    }
  }

  void Woken() {
    waking_ = false;
    std::unique_lock lock(mutex_);
    news_ = true;
    Step(std::move(lock));
  }

  // Answers Next, or does what has to be done before. Gives the lock back.
  void Step(std::unique_lock<std::mutex> lock) {
    if (taken_ == nullptr) return;
    if (!end_ && outbox_.empty()) {
      if (!ended_) return ReadIfNews();
      end_ = absl::OkStatus();
      subscription_ = {};
    }
    Batch batch;
    batch.end = end_;
    if (!end_) batch.parts = TakeFront(outbox_, limit_);
    const Taken taken = std::exchange(taken_, nullptr);
    lock.unlock();
    taken(std::move(batch));
  }

  // Under the lock.
  void ReadIfNews() {
    if (reading_ || !news_) return;
    reading_ = true;
    news_ = false;
    context_.executors.For(Work::kRead).Post([self = std::static_pointer_cast<CampaignFeed>(shared_from_this())] {
      self->Read();
    });
  }

  void EndWith(std::unique_lock<std::mutex> lock, const absl::Status& status) {
    if (end_) return;
    end_ = status;
    subscription_ = {};
    Step(std::move(lock));
  }

  // Constant after construction.
  const v1::WatchCampaignRequest request_;
  const CampaignFeedContext context_;

  std::atomic<bool> waking_ = false;  // a wake is posted that has not begun

  // Written under mutex_ by the one task that reads the store, and read by it without.
  std::string id_;  // empty: not opened
  std::int64_t read_seq_ = 0;
  std::int64_t snapshot_seq_ = 0;
  std::string progress_;  // the last one sent

  std::mutex mutex_;
  // Guarded by mutex_.
  Taken taken_;  // while Next is under way
  std::size_t limit_ = 0;
  std::deque<StreamPart> outbox_;
  bool news_ = true;      // something may have come since the store was last asked
  bool reading_ = false;  // the store is being read
  bool ended_ = false;    // the event that ends the campaign is in the outbox, or sent
  std::optional<absl::Status> end_;

  CampaignEngine::Subscription subscription_;  // guarded by mutex_; ends before all that a wake uses
};

}  // namespace

std::shared_ptr<Feed> NewCampaignFeed(const v1::WatchCampaignRequest& request, const CampaignFeedContext& context) {
  auto feed = std::make_shared<CampaignFeed>(request, context);
  context.feeds.Add(feed);
  return feed;
}

}  // namespace orbitune
