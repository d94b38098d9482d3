#include "server/rpc/watch.h"

#include <deque>

#include "absl/strings/str_cat.h"
#include "server/convert/job.h"
#include "server/rpc/status.h"

namespace orbitune {
namespace {

constexpr int kPage = 256;  // events taken at a time

bool EndsJob(const JobEvent& event) {
  const auto* change = std::get_if<StateChange>(&event.what);
  return change != nullptr && IsTerminal(change->state);
}

}  // namespace

// At any time a watcher is opening, filling (a task reads the store), writing (gRPC has a message), idle (waiting for
// the hub's wake) or finished; all is decided under mutex_.
class Watcher : public grpc::ServerWriteReactor<v1::WatchJobResponse>, public std::enable_shared_from_this<Watcher> {
 public:
  Watcher(const v1::WatchJobRequest& request, UseCases& use_cases, Executor& executor, Watchers& watchers)
      : request_(request), use_cases_(use_cases), executor_(executor), watchers_(watchers) {}

  void Begin() {
    self_ = shared_from_this();
    if (!watchers_.Add(self_)) return EndWith(absl::UnavailableError("the server is going down"));
    Post(&Watcher::Open);
  }

  void EndWith(const absl::Status& status) {
    const std::lock_guard lock(mutex_);
    EndLocked(status);
  }

  void OnWriteDone(bool ok) override {
    const std::lock_guard lock(mutex_);
    writing_ = false;
    if (!ok) return EndLocked(absl::CancelledError("the watcher is gone"));
    if (end_status_) return EndLocked(*end_status_);
    StepLocked();
  }

  void OnCancel() override { EndWith(absl::CancelledError("cancelled by the watcher")); }

  void OnDone() override {
    subscription_ = {};  // waits for a wake that is running
    watchers_.Remove(self_);
    self_.reset();  // the last reference but a task's
  }

 private:
  void Post(void (Watcher::*task)()) {
    executor_.Post([self = shared_from_this(), task] { (*self.*task)(); });
  }

  // On the executor: the snapshot, before anything else.
  void Open() {
    const auto id = IdFromName("jobs", request_.name(), "name");
    if (!id.ok()) return EndWith(id.status());
    id_ = *id;
    // Before the snapshot is read: what is committed after it then wakes us.
    auto subscription = use_cases_.hub().Subscribe(id_, [this] { Wake(); });
    const auto job = use_cases_.GetJob(id_);
    const std::lock_guard lock(mutex_);
    // OnDone may have been, and with it the last chance to end a subscription while this object is whole.
    if (finished_) return;
    subscription_ = std::move(subscription);
    if (!job.ok()) return EndLocked(job.status());
    if (!v1::Delivery_IsValid(request_.delivery())) {
      return EndLocked(InvalidField("delivery", "EVERY or LATEST", request_.delivery()));
    }
    if (request_.resume_after_seq() < -1 || request_.resume_after_seq() > job->last_seq) {
      return EndLocked(InvalidField("resume_after_seq", absl::StrCat("in [-1, ", job->last_seq, "], the job's last"),
                                    static_cast<double>(request_.resume_after_seq())));
    }
    const bool from_now = request_.resume_after_seq() == -1;
    sent_seq_ = from_now ? job->last_seq : request_.resume_after_seq();
    // Nothing will follow a job's end.
    ended_ = IsTerminal(job->state) && sent_seq_ == job->last_seq;
    v1::WatchJobResponse snapshot;
    snapshot.set_seq(job->last_seq);
    ToProto(*job, snapshot.mutable_snapshot());
    outbox_.push_back(std::move(snapshot));
    latest_ = request_.delivery() == v1::DELIVERY_LATEST;
    opened_ = true;
    StepLocked();
  }

  // On the executor: what the hub does not keep (any more).
  void Fill() {
    std::int64_t after = 0;
    {
      const std::lock_guard lock(mutex_);
      after = sent_seq_;
      caught_up_ = true;  // unless a wake comes while the store is read
    }
    const auto events = use_cases_.store().ListEvents(id_, after, kPage);
    const std::lock_guard lock(mutex_);
    filling_ = false;
    if (!events.ok()) return EndLocked(events.status());
    if (events->size() == static_cast<std::size_t>(kPage)) caught_up_ = false;
    for (const JobEvent& event : *events) TakeLocked(event);
    StepLocked();
  }

  // From the hub, under its lock: nothing here may wait for mutex_, under which the hub is called.
  void Wake() {
    if (!waking_.exchange(true)) Post(&Watcher::Woken);
  }

  void Woken() {
    waking_ = false;
    const std::lock_guard lock(mutex_);
    caught_up_ = false;
    StepLocked();
  }

  // Puts an event into the outbox. LATEST: an iteration still unsent makes room for the next one.
  void TakeLocked(const JobEvent& event) {
    if (ended_ || event.seq <= sent_seq_) return;
    sent_seq_ = event.seq;
    ended_ = EndsJob(event);
    if (latest_ && std::holds_alternative<IterationRecord>(event.what) && !outbox_.empty() &&
        outbox_.back().has_iteration()) {
      SkipLocked(outbox_.back().seq());
    }
    ToProto(event, &outbox_.emplace_back());
  }

  // Turns the iteration at the back, of seq `skipped`, into a gap, or widens the gap before it.
  void SkipLocked(std::int64_t skipped) {
    outbox_.pop_back();
    if (outbox_.empty() || !outbox_.back().has_gap()) {
      outbox_.emplace_back().mutable_gap()->set_first_seq(skipped);
    }
    outbox_.back().set_seq(skipped);
    outbox_.back().mutable_gap()->set_last_seq(skipped);
  }

  // Does the next thing, if nothing is under way.
  void StepLocked() {
    if (!opened_ || writing_ || filling_ || finished_) return;
    // LATEST takes what is new before every write, so as to send the newest.
    if (!ended_ && (latest_ || outbox_.empty()) && !PullLocked()) return;
    if (!outbox_.empty()) {
      sending_ = std::move(outbox_.front());
      outbox_.pop_front();
      writing_ = true;
      StartWrite(&sending_);
    } else if (ended_) {
      EndLocked(absl::OkStatus());
    }
  }

  // Takes what is new. False if the store has to be read first: that is under way then.
  bool PullLocked() {
    while (!ended_) {
      const EventHub::Recent recent = use_cases_.hub().After(id_, sent_seq_, kPage);
      if (!recent.complete && !caught_up_) {
        filling_ = true;
        Post(&Watcher::Fill);
        return false;
      }
      for (const EventHub::Event& event : recent.events) TakeLocked(*event);
      if (recent.events.size() < static_cast<std::size_t>(kPage) || !latest_) break;
    }
    return true;
  }

  // A write in flight comes first; a cancelled call's ends at once.
  void EndLocked(const absl::Status& status) {
    if (!end_status_) end_status_ = status;
    if (writing_ || finished_) return;
    finished_ = true;
    Finish(ToGrpc(*end_status_));
  }

  // Constant after construction.
  const v1::WatchJobRequest request_;
  UseCases& use_cases_;
  Executor& executor_;
  Watchers& watchers_;

  std::shared_ptr<Watcher> self_;  // until OnDone
  std::string id_;                 // set by Open
  EventHub::Subscription subscription_;
  std::atomic<bool> waking_ = false;  // a wake is posted that has not begun

  std::mutex mutex_;
  // Guarded by mutex_.
  std::deque<v1::WatchJobResponse> outbox_;
  v1::WatchJobResponse sending_;
  std::int64_t sent_seq_ = 0;  // the newest in the outbox, or sent
  bool latest_ = false;
  bool opened_ = false;
  bool writing_ = false;
  bool filling_ = false;
  bool caught_up_ = false;  // the store has been read to its end (or is being), and no wake has come since
  bool ended_ = false;      // the event that ends the job is in the outbox, or sent
  std::optional<absl::Status> end_status_;  // once the call is to end
  bool finished_ = false;                   // Finish was called
};

bool Watchers::Add(const std::shared_ptr<Watcher>& watcher) {
  const std::lock_guard lock(mutex_);
  if (!drained_) watchers_.insert(watcher);
  return !drained_;
}

void Watchers::Remove(const std::shared_ptr<Watcher>& watcher) {
  const std::lock_guard lock(mutex_);
  watchers_.erase(watcher);
}

void Watchers::Drain() {
  std::set<std::shared_ptr<Watcher>> watchers;
  {
    const std::lock_guard lock(mutex_);
    drained_ = true;
    watchers = watchers_;
  }
  for (const auto& watcher : watchers) watcher->EndWith(absl::UnavailableError("the server is going down"));
}

grpc::ServerWriteReactor<v1::WatchJobResponse>* StartWatch(const v1::WatchJobRequest& request, UseCases& use_cases,
                                                           Executor& executor, Watchers& watchers) {
  auto watcher = std::make_shared<Watcher>(request, use_cases, executor, watchers);
  watcher->Begin();
  return watcher.get();
}

}  // namespace orbitune
