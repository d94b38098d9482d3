#include "server/api/job_feed.h"

#include <algorithm>
#include <atomic>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "server/convert/job.h"

namespace orbitune {
namespace {

constexpr int kPage = 256;  // events taken at a time

bool EndsJob(const JobEvent& event) {
  const auto* change = std::get_if<StateChange>(&event.what);
  return change != nullptr && IsTerminal(change->state);
}

bool IsIteration(const JobEvent& event) { return std::holds_alternative<IterationRecord>(event.what); }

// At any time a feed is opening or filling (a task reads the store), idle (waiting for the hub's wake), or not asked
// for anything; all is decided under mutex_.
class JobFeed final : public Feed {
 public:
  JobFeed(const v1::WatchJobRequest& request, const JobFeedContext& context) : request_(request), context_(context) {}
  ~JobFeed() override { context_.feeds.Remove(this); }

  void Next(std::size_t limit, Taken taken) override {
    std::unique_lock lock(mutex_);
    ORBITUNE_CHECK(taken_ == nullptr && limit > 0);
    limit_ = limit;
    taken_ = std::move(taken);
    if (!asked_ && !end_) Post(&JobFeed::Open);
    asked_ = true;
    Step(std::move(lock));
  }

  void End(const absl::Status& status) override { EndWith(std::unique_lock(mutex_), status); }

 private:
  // What is to be sent: an event, or (none) a gap up to it.
  struct Pending {
    std::int64_t first_seq;
    std::int64_t seq;
    EventHub::Event event;
  };

  void Post(void (JobFeed::*task)()) {
    context_.executors.For(Work::kRead).Post([self = std::static_pointer_cast<JobFeed>(shared_from_this()), task] {
      (*self.*task)();
    });
  }

  // On the executor: the snapshot, before anything else.
  void Open() {
    const auto id = IdFromName("jobs", request_.name(), "name");
    if (!id.ok()) return End(id.status());
    id_ = *id;
    // Before the snapshot is read: what is committed after it then wakes us.
    auto subscription = context_.use_cases.hub().Subscribe(id_, [this] { Wake(); });
    const auto job = context_.use_cases.GetJob(id_);
    std::unique_lock lock(mutex_);
    if (end_) return;
    subscription_ = std::move(subscription);
    if (!job.ok()) return EndWith(std::move(lock), job.status());
    if (absl::Status status = Check(*job); !status.ok()) return EndWith(std::move(lock), status);
    latest_ = request_.delivery() == v1::DELIVERY_LATEST;
    sent_seq_ = request_.resume_after_seq() == -1 ? job->last_seq : request_.resume_after_seq();
    // Nothing will follow a job's end.
    ended_ = IsTerminal(job->state) && sent_seq_ == job->last_seq;
    auto snapshot = std::make_unique<v1::WatchJobResponse>();
    snapshot->set_seq(job->last_seq);
    ToProto(*job, snapshot->mutable_snapshot());
    snapshot_ = FeedItem{sent_seq_, "snapshot", std::make_shared<StreamMessage>(std::move(snapshot))};
    opened_ = true;
    Step(std::move(lock));
  }

  absl::Status Check(const JobRecord& job) const {
    if (!v1::Delivery_IsValid(request_.delivery())) {
      return InvalidField("delivery", "EVERY or LATEST", request_.delivery());
    }
    if (request_.resume_after_seq() < -1 || request_.resume_after_seq() > job.last_seq) {
      return InvalidField("resume_after_seq", absl::StrCat("in [-1, ", job.last_seq, "], the job's last"),
                          static_cast<double>(request_.resume_after_seq()));
    }
    return absl::OkStatus();
  }

  // On the executor: what the hub does not keep (any more).
  void Fill() {
    std::int64_t after = 0;
    {
      const std::lock_guard lock(mutex_);
      after = sent_seq_;
      caught_up_ = true;  // unless a wake comes while the store is read
    }
    auto events = context_.use_cases.store().ListEvents(id_, after, kPage);
    std::unique_lock lock(mutex_);
    filling_ = false;
    if (!events.ok()) return EndWith(std::move(lock), events.status());
    if (events->size() == static_cast<std::size_t>(kPage)) caught_up_ = false;
    for (JobEvent& event : *events) Take(std::make_shared<const JobEvent>(std::move(event)));
    Step(std::move(lock));
  }

  // From the hub, under its lock: nothing here may wait for mutex_, under which the hub is called. Costs next to
  // nothing where nobody waits for news.
  void Wake() {
    news_ = true;
    if (!idle_ || waking_.exchange(true)) return;
    // Not while the last holder is letting go.
    if (auto self = std::static_pointer_cast<JobFeed>(weak_from_this().lock())) {
      context_.executors.For(Work::kRead).Post([self = std::move(self)] { self->Woken(); });
    }
  }

  void Woken() {
    waking_ = false;
    Step(std::unique_lock(mutex_));
  }

  // Under the lock. LATEST: an iteration still unsent makes room for the next one.
  void Take(EventHub::Event event) {
    if (ended_ || event->seq <= sent_seq_) return;
    sent_seq_ = event->seq;
    ended_ = EndsJob(*event);
    if (latest_ && IsIteration(*event) && !outbox_.empty() && outbox_.back().event != nullptr &&
        IsIteration(*outbox_.back().event)) {
      SkipLast();
    }
    outbox_.push_back({event->seq, event->seq, std::move(event)});
  }

  // Under the lock: turns the iteration at the back into a gap, or widens the gap before it.
  void SkipLast() {
    const std::int64_t skipped = outbox_.back().seq;
    outbox_.pop_back();
    if (outbox_.empty() || outbox_.back().event != nullptr) outbox_.push_back({skipped, skipped, nullptr});
    outbox_.back().seq = skipped;
  }

  // Answers Next, or does what has to be done before. Gives the lock back.
  void Step(std::unique_lock<std::mutex> lock) {
    if (taken_ == nullptr || (!end_ && !Ready())) return;
    Batch batch;
    if (end_) {
      batch.end = end_;
    } else {
      batch.items = Items();
    }
    idle_ = false;
    const Taken taken = std::exchange(taken_, nullptr);
    lock.unlock();
    taken(std::move(batch));
  }

  // Under the lock: whether there is something to hand over. If not, what brings it is under way.
  bool Ready() {
    if (!opened_ || filling_) return false;
    do {
      // LATEST takes what is new before every write, so as to send the newest.
      if (!ended_ && (latest_ || outbox_.empty()) && !Pull()) return false;
      if (snapshot_ || !outbox_.empty()) return true;
      if (ended_) {
        end_ = absl::OkStatus();
        subscription_ = {};
        return true;
      }
      idle_ = true;   // from here on a wake posts a task
    } while (news_);  // one that came just before did not
    return false;
  }

  // Under the lock: takes what is new. False if the store has to be read first: that is under way then.
  bool Pull() {
    if (news_.exchange(false)) caught_up_ = false;
    while (!ended_) {
      const EventHub::Recent recent = context_.use_cases.hub().After(id_, sent_seq_, kPage);
      if (!recent.complete && !caught_up_) {
        filling_ = true;
        Post(&JobFeed::Fill);
        return false;
      }
      for (const EventHub::Event& event : recent.events) Take(event);
      if (recent.events.size() < static_cast<std::size_t>(kPage) || !latest_) break;
    }
    return true;
  }

  // Under the lock: what is to be sent next, as messages.
  std::vector<FeedItem> Items() {
    std::vector<FeedItem> items;
    items.reserve(std::min(limit_, outbox_.size() + 1));
    if (snapshot_) items.push_back(*std::exchange(snapshot_, std::nullopt));
    while (items.size() < limit_ && !outbox_.empty()) {
      items.push_back(ToItem(outbox_.front()));
      outbox_.pop_front();
    }
    return items;
  }

  FeedItem ToItem(const Pending& pending) {
    if (pending.event != nullptr) {
      const char* kind = IsIteration(*pending.event) ? "iteration" : "state_change";
      return {pending.seq, kind, context_.messages.Get(id_, *pending.event)};
    }
    auto gap = std::make_unique<v1::WatchJobResponse>();
    gap->set_seq(pending.seq);
    gap->mutable_gap()->set_first_seq(pending.first_seq);
    gap->mutable_gap()->set_last_seq(pending.seq);
    return {pending.seq, "gap", std::make_shared<StreamMessage>(std::move(gap))};
  }

  void EndWith(std::unique_lock<std::mutex> lock, const absl::Status& status) {
    if (end_) return;
    end_ = status;
    subscription_ = {};
    Step(std::move(lock));
  }

  // Constant after construction.
  const v1::WatchJobRequest request_;
  const JobFeedContext context_;

  std::string id_;                    // set by Open
  std::atomic<bool> news_ = false;    // a wake has come since the hub was last asked
  std::atomic<bool> idle_ = false;    // Next waits for a wake
  std::atomic<bool> waking_ = false;  // a wake is posted that has not begun

  std::mutex mutex_;
  // Guarded by mutex_.
  Taken taken_;  // while Next is under way
  std::size_t limit_ = 0;
  std::optional<FeedItem> snapshot_;  // until it is sent
  std::deque<Pending> outbox_;
  std::int64_t sent_seq_ = 0;  // the newest in the outbox, or sent
  bool latest_ = false;
  bool asked_ = false;
  bool opened_ = false;
  bool filling_ = false;
  bool caught_up_ = false;  // the store has been read to its end (or is being), and no wake has come since
  bool ended_ = false;      // the event that ends the job is in the outbox, or sent
  std::optional<absl::Status> end_;

  EventHub::Subscription subscription_;  // guarded by mutex_; ends before all that a wake uses
};

}  // namespace

std::shared_ptr<const StreamMessage> JobEventMessages::Get(const std::string& job_id, const JobEvent& event) {
  const std::lock_guard lock(mutex_);
  auto& message = jobs_[job_id][event.seq];
  if (message != nullptr) return message;
  auto proto = std::make_unique<v1::WatchJobResponse>();
  ToProto(event, proto.get());
  auto made = message = std::make_shared<const StreamMessage>(std::move(proto));
  kept_.emplace_back(job_id, event.seq);
  if (kept_.size() > most_kept_) {
    const auto& [job, seq] = kept_.front();
    const auto oldest = jobs_.find(job);
    oldest->second.erase(seq);
    if (oldest->second.empty()) jobs_.erase(oldest);
    kept_.pop_front();
  }
  return made;
}

std::shared_ptr<Feed> NewJobFeed(const v1::WatchJobRequest& request, const JobFeedContext& context) {
  auto feed = std::make_shared<JobFeed>(request, context);
  context.feeds.Add(feed);
  return feed;
}

}  // namespace orbitune
