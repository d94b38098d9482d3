#include "server/api/job_feed.h"

#include <algorithm>
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

FeedItem ToItem(const JobEvent& event) {
  auto message = std::make_unique<v1::WatchJobResponse>();
  ToProto(event, message.get());
  const char* kind = message->has_iteration() ? "iteration" : "state_change";
  return std::make_shared<const StreamMessage>(StreamMessage{{event.seq, kind, EndsJob(event)}, std::move(message)});
}

StreamPart Gap(std::int64_t first_seq, std::int64_t last_seq) {
  auto message = std::make_unique<v1::WatchJobResponse>();
  message->set_seq(last_seq);
  message->mutable_gap()->set_first_seq(first_seq);
  message->mutable_gap()->set_last_seq(last_seq);
  return PartOf({{last_seq, "gap"}, std::move(message)});
}

bool IsIteration(const FeedItem& item) { return item->about.kind == "iteration"; }
bool IsGap(const FeedItem& item) { return item->about.kind == "gap"; }

StreamPart ToBatch(const std::vector<FeedItem>& iterations) {
  auto message = std::make_unique<v1::WatchJobResponse>();
  const std::int64_t seq = iterations.back()->about.resume_after_seq;
  message->set_seq(seq);
  for (const FeedItem& item : iterations) {
    const auto& one = static_cast<const v1::WatchJobResponse&>(*item->message);
    *message->mutable_iteration_batch()->add_iterations() = one.iteration();
  }
  return PartOf(
      {{.resume_after_seq = seq, .kind = "iteration_batch", .events = iterations.size()}, std::move(message)});
}

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

  std::int64_t lag() override {
    const std::lock_guard lock(mutex_);
    if (!opened_ || end_) return 0;
    std::int64_t held = 0;
    for (const StreamPart& part : outbox_) held += static_cast<std::int64_t>(part.size());
    return std::max<std::int64_t>(held, context_.use_cases.hub().LastSeq(id_) - sent_seq_ + held);
  }

 private:
  void Post(void (JobFeed::*task)()) {
    context_.executors.For(Work::kStream).Post([self = std::static_pointer_cast<JobFeed>(shared_from_this()), task] {
      (*self.*task)();
    });
  }

  // On the executor: the snapshot, before anything else.
  void Open() {
    const auto id = IdFromName("jobs", request_.name(), "name");
    if (!id.ok()) return End(id.status());
    id_ = *id;
    // Before the snapshot is read: what is committed after it then wakes us.
    auto subscription = context_.use_cases.hub().SubscribeOnDemand(id_, [this] { Wake(); });
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
    outbox_.push_back(PartOf({{sent_seq_, "snapshot", ended_}, std::move(snapshot)}));
    opened_ = true;
    Step(std::move(lock));
  }

  absl::Status Check(const JobRecord& job) const {
    if (!v1::Delivery_IsValid(request_.delivery())) {
      return InvalidField("delivery", "EVERY or LATEST", request_.delivery());
    }
    if (request_.max_iterations_per_message() < 0 || request_.max_iterations_per_message() > kPage) {
      return InvalidField("max_iterations_per_message", absl::StrCat("in [0, ", kPage, "]"),
                          request_.max_iterations_per_message());
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
      caught_up_ = true;  // unless something is published while the store is read
    }
    // Where many are at one place, one of them reads it for all.
    std::vector<StreamPart> parts = context_.messages.After(id_, after, kPage);
    std::vector<EventHub::Event> read;
    if (parts.empty()) {
      auto events = context_.use_cases.store().ListEvents(id_, after, kPage);
      if (!events.ok()) return End(events.status());
      for (JobEvent& event : *events) read.push_back(std::make_shared<const JobEvent>(std::move(event)));
    }
    std::unique_lock lock(mutex_);
    filling_ = false;
    if (!parts.empty() || read.size() == kPage) caught_up_ = false;
    for (StreamPart& part : parts) Take(std::move(part));
    TakeEvents(read);
    Step(std::move(lock));
  }

  // Under the lock. Events are missing between them only where retention removed iterations: that is told.
  void TakeEvents(const std::vector<EventHub::Event>& events) {
    for (auto begin = events.begin(); begin != events.end();) {
      const auto end =
          std::adjacent_find(begin, events.end(), [](const auto& a, const auto& b) { return b->seq != a->seq + 1; });
      const auto behind = end == events.end() ? end : end + 1;
      if ((*begin)->seq > sent_seq_ + 1) Take(Gap(sent_seq_ + 1, (*begin)->seq - 1));
      for (const StreamPart& part : context_.messages.Of(id_, {begin, behind})) Take(part);
      begin = behind;
    }
  }

  // From the hub, under its lock: nothing here may wait for mutex_, under which the hub is called.
  void Wake() {
    // Not while the last holder is letting go.
    if (auto self = std::static_pointer_cast<JobFeed>(weak_from_this().lock())) {
      context_.executors.For(Work::kStream).Post([self = std::move(self)] {
        self->Step(std::unique_lock(self->mutex_));
      });
    }
  }

  // Under the lock.
  void Take(StreamPart part) {
    while (part.size() > 0 && part.front()->about.resume_after_seq <= sent_seq_) ++part.begin;
    if (ended_ || part.size() == 0) return;
    sent_seq_ = part.back()->about.resume_after_seq;
    ended_ = part.back()->about.last;
    if (!latest_) return outbox_.push_back(std::move(part));
    for (; part.size() > 0; ++part.begin) TakeLatest({.run = part.run, .begin = part.begin, .end = part.begin + 1});
  }

  // Under the lock: one message; an iteration still unsent makes room for the next one.
  void TakeLatest(StreamPart one) {
    if (IsIteration(one.front()) && !outbox_.empty() && IsIteration(outbox_.back().back())) SkipLast();
    outbox_.push_back(std::move(one));
  }

  // Under the lock: turns the iteration at the back into a gap, or widens the gap before it.
  void SkipLast() {
    const std::int64_t skipped = outbox_.back().back()->about.resume_after_seq;
    outbox_.pop_back();
    std::int64_t first = skipped;
    if (!outbox_.empty() && IsGap(outbox_.back().back())) {
      first = static_cast<const v1::WatchJobResponse&>(*outbox_.back().back()->message).gap().first_seq();
      outbox_.pop_back();
    }
    outbox_.push_back(Gap(first, skipped));
  }

  // Answers Next, or does what has to be done before. Gives the lock back.
  void Step(std::unique_lock<std::mutex> lock) {
    if (taken_ == nullptr || (!end_ && !Ready())) return;
    Batch batch;
    batch.end = end_;
    if (!end_) batch.parts = request_.max_iterations_per_message() > 1 ? TakeBatches() : TakeFront(outbox_, limit_);
    const Taken taken = std::exchange(taken_, nullptr);
    lock.unlock();
    taken(std::move(batch));
  }

  // Under the lock: as TakeFront, with iterations that follow one another as batches.
  std::vector<StreamPart> TakeBatches() {
    const auto most = static_cast<std::size_t>(request_.max_iterations_per_message());
    std::vector<StreamPart> taken;
    while (taken.size() < limit_ && !outbox_.empty()) {
      std::vector<FeedItem> items;
      StreamPart one;
      do {
        one = TakeFront(outbox_, 1).front();
        items.push_back(one.front());
      } while (items.size() < most && IsIteration(items.back()) && !outbox_.empty() &&
               IsIteration(outbox_.front().front()));
      taken.push_back(items.size() > 1 ? ToBatch(items) : one);
    }
    return taken;
  }

  // Under the lock: whether there is something to hand over. If not, what brings it is under way.
  bool Ready() {
    if (!opened_ || filling_) return false;
    do {
      // LATEST takes what is new before every write, so as to send the newest.
      if (!ended_ && (latest_ || outbox_.empty()) && !Pull()) return false;
      if (!outbox_.empty()) return true;
      if (ended_) {
        end_ = absl::OkStatus();
        subscription_ = {};
        return true;
      }
    } while (!subscription_.WakeAtNext(seen_));
    return false;
  }

  // Under the lock: takes what is new. False if the store has to be read first: that is under way then.
  bool Pull() {
    const std::uint64_t publications = subscription_.publications();
    if (std::exchange(seen_, publications) != publications) caught_up_ = false;
    while (!ended_) {
      std::vector<StreamPart> parts = context_.messages.After(id_, sent_seq_, kPage);
      if (parts.empty()) {
        const EventHub::Recent recent = context_.use_cases.hub().After(id_, sent_seq_, kPage);
        if (!recent.complete && !caught_up_) {
          filling_ = true;
          Post(&JobFeed::Fill);
          return false;
        }
        parts = context_.messages.Of(id_, recent.events);
      }
      for (const StreamPart& part : parts) Take(part);
      if (parts.empty() || !latest_) break;
    }
    return true;
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

  std::string id_;  // set by Open

  std::mutex mutex_;
  // Guarded by mutex_.
  Taken taken_;  // while Next is under way
  std::size_t limit_ = 0;
  std::deque<StreamPart> outbox_;
  std::int64_t sent_seq_ = 0;  // the newest in the outbox, or sent
  bool latest_ = false;
  bool asked_ = false;
  bool opened_ = false;
  bool filling_ = false;
  std::uint64_t seen_ = 0;  // publications when the hub was last asked
  bool caught_up_ = false;  // the store has been read to its end (or is being), and nothing was published since
  bool ended_ = false;      // the event that ends the job is in the outbox, or sent
  std::optional<absl::Status> end_;

  EventHub::Subscription subscription_;  // guarded by mutex_; ends before all that a wake uses
};

}  // namespace

std::optional<StreamPart> JobEventMessages::From(const Runs& runs, std::int64_t seq, std::size_t limit) {
  auto found = runs.upper_bound(seq);
  if (found == runs.begin()) return std::nullopt;
  const auto& [first, run] = *--found;
  const auto begin = static_cast<std::size_t>(seq - first);
  if (begin >= run->items().size()) return std::nullopt;
  return StreamPart{.run = run, .begin = begin, .end = std::min(run->items().size(), begin + limit)};
}

std::vector<StreamPart> JobEventMessages::After(const std::string& job_id, std::int64_t after_seq,
                                                std::size_t limit) const {
  std::vector<StreamPart> parts;
  const std::lock_guard lock(mutex_);
  const auto job = jobs_.find(job_id);
  if (job == jobs_.end()) return parts;
  std::int64_t seq = after_seq + 1;
  while (limit > 0) {
    auto part = From(job->second, seq, limit);
    if (!part) break;
    seq += static_cast<std::int64_t>(part->size());
    limit -= part->size();
    parts.push_back(*std::move(part));
  }
  return parts;
}

std::vector<StreamPart> JobEventMessages::Of(const std::string& job_id, const std::vector<EventHub::Event>& events) {
  std::vector<StreamPart> parts;
  if (events.empty()) return parts;
  const std::lock_guard lock(mutex_);
  Runs& runs = jobs_[job_id];
  for (auto event = events.begin(); event != events.end(); event += static_cast<std::ptrdiff_t>(parts.back().size())) {
    const std::int64_t seq = (*event)->seq;
    auto limit = events.end() - event;
    auto part = From(runs, seq, static_cast<std::size_t>(limit));
    if (!part) {
      const auto next = runs.upper_bound(seq);
      if (next != runs.end()) limit = std::min<std::ptrdiff_t>(limit, next->first - seq);
      std::vector<FeedItem> items;
      std::transform(event, event + limit, std::back_inserter(items), [](const auto& e) { return ToItem(*e); });
      const auto run = std::make_shared<const StreamRun>(std::move(items));
      runs.emplace(seq, run);
      kept_.emplace_back(job_id, seq);
      kept_messages_ += run->items().size();
      part = StreamPart{.run = run, .begin = 0, .end = run->items().size()};
    }
    parts.push_back(*std::move(part));
  }
  while (kept_messages_ > most_kept_) ForgetOldest();
  return parts;
}

void JobEventMessages::ForgetOldest() {
  const auto& [job_id, seq] = kept_.front();
  const auto job = jobs_.find(job_id);
  const auto run = job->second.find(seq);
  kept_messages_ -= run->second->items().size();
  job->second.erase(run);
  if (job->second.empty()) jobs_.erase(job);
  kept_.pop_front();
}

std::shared_ptr<Feed> NewJobFeed(const v1::WatchJobRequest& request, const JobFeedContext& context) {
  auto feed = std::make_shared<JobFeed>(request, context);
  context.feeds.Add(feed);
  return feed;
}

}  // namespace orbitune
