// The life of the scheduler and of a job's states; scheduler_parts.h says where the rest is.
#include "server/jobs/scheduler.h"

#include <chrono>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "server/jobs/gain_sets.h"
#include "server/jobs/scheduler_parts.h"
#include "server/log/log.h"
#include "storage/serialise.h"

namespace orbitune {
namespace {

void LogChange(const JobRecord& job) {
  constexpr std::string_view kChanges[] = {"job queued", "job begun", "job paused",
                                           "job ended",  "job ended", "job ended"};
  const bool ended = IsTerminal(job.state);
  const double seconds = static_cast<double>(job.end_time_us - job.start_time_us) * 1e-6;
  Log(LogLevel::kInfo, kChanges[static_cast<std::size_t>(job.state)],
      {{"job", job.id},
       {"state", ended ? NameOf(job.state) : ""},
       {"client", ClientOf(job.spec)},
       {"campaign", job.spec.campaign_id},
       {"iterations", job.completed_iterations()},
       {"seconds", ended && job.start_time_us > 0 ? seconds : kUnset},
       {"error", job.error_message}});
}

// Of all the iterations that a job has stored.
absl::StatusOr<std::int64_t> StoredPairsLeftOut(const JobStore& store, const JobRecord& job) {
  constexpr int kPage = 10'000;
  std::int64_t sum = 0;
  for (int after = 0; after < job.completed_iterations();) {
    const auto records = store.ListIterations(job.id, after, kPage);
    if (!records.ok()) return records.status();
    if (records->empty()) return absl::DataLossError(absl::StrCat("job ", job.id, ": its history ends at ", after));
    for (const IterationRecord& record : *records) sum += record.pairs_left_out;
    after = records->back().iteration;
  }
  return sum;
}

}  // namespace

std::string EtagOf(const JobRecord& record) { return absl::StrCat(record.id, "-", record.state_changes); }

absl::Status CheckEtag(const JobRecord& record, const std::string& etag) {
  if (etag.empty() || etag == EtagOf(record)) return absl::OkStatus();
  return WithReason(absl::AbortedError(absl::StrCat("etag: jobs/", record.id, " has changed: its etag is ",
                                                    EtagOf(record), ", got ", FormatReceived(etag))),
                    "ETAG_MISMATCH");
}

absl::Status WrongState(const std::string& id, JobState state, std::string_view action, std::string_view needed) {
  return WithReason(absl::FailedPreconditionError(absl::StrCat("jobs/", id, " is ", ToAbsl(NameOf(state)), "; to ",
                                                               ToAbsl(action), " it, it must be ", ToAbsl(needed))),
                    "JOB_STATE");
}

Scheduler::Scheduler(JobStore& store, EventHub& hub, Options options) : store_(store), hub_(hub), options_(options) {
  ORBITUNE_CHECK(options.threads > 0 && options.max_running_jobs > 0 && options.max_uncommitted_iterations > 0);
}

Scheduler::~Scheduler() {
  Stop();
  // Jobs and their clients hold each other.
  for (const auto& [name, client] : clients_) {
    client->running.clear();
    client->waiting.clear();
  }
}

absl::Status Scheduler::Start() {
  auto unfinished = store_.ListUnfinishedJobs();
  if (!unfinished.ok()) return unfinished.status();
  {
    const std::lock_guard lock(mutex_);
    for (JobRecord& record : *unfinished) {
      const auto pairs_left_out = StoredPairsLeftOut(store_, record);
      if (!pairs_left_out.ok()) return pairs_left_out.status();
      const EntryPtr entry = AddEntry(std::move(record));
      entry->pairs_left_out = *pairs_left_out;
      if (entry->record.state != JobState::kPaused) PutIntoQueue(entry);
    }
    StartWaiting();
  }
  for (int i = 0; i < options_.threads; ++i) workers_.emplace_back([this] { WorkerLoop(); });
  return absl::OkStatus();
}

void Scheduler::Stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    for (const auto& [id, entry] : entries_) {
      if (entry->run != nullptr) entry->run->MarkUnwanted();
    }
    Signal();
  }
  for (std::thread& worker : workers_) worker.join();
  workers_.clear();
  store_.Flush();  // its callbacks point here
}

void Scheduler::Add(const JobRecord& created) {
  const std::lock_guard lock(mutex_);
  // A repeated request may bring a job that is here already.
  if (entries_.contains(created.id)) return;
  PutIntoQueue(AddEntry(created));
  StartWaiting();
  Signal();
}

JobCounts Scheduler::counts() {
  const std::lock_guard lock(mutex_);
  const auto in = [this](JobState state) { return by_state_[static_cast<std::size_t>(state)]; };
  return {.queued = in(JobState::kQueued), .running = in(JobState::kRunning), .paused = in(JobState::kPaused)};
}

void Scheduler::Pause(const std::string& id, const std::string& etag, Done done) {
  Transition(
      id, etag, "pause", "QUEUED or RUNNING",
      [](JobState s) { return s == JobState::kQueued || s == JobState::kRunning; }, JobState::kPaused, std::move(done));
}

void Scheduler::Resume(const std::string& id, const std::string& etag, Done done) {
  Transition(
      id, etag, "resume", "PAUSED", [](JobState s) { return s == JobState::kPaused; }, JobState::kQueued,
      std::move(done));
}

void Scheduler::Cancel(const std::string& id, const std::string& etag, Done done) {
  Transition(
      id, etag, "cancel", "QUEUED, RUNNING or PAUSED", [](JobState s) { return !IsTerminal(s); }, JobState::kCancelled,
      std::move(done));
}

void Scheduler::Transition(const std::string& id, const std::string& etag, std::string_view action,
                           std::string_view needed, const std::function<bool(JobState)>& allowed, JobState to,
                           Done done) {
  Lock lock(mutex_);
  const auto found = entries_.find(id);
  if (found == entries_.end()) {
    lock.unlock();
    // A job whose last change is still on its way to the disk is there once that is.
    store_.Flush();
    auto ended = store_.GetJob(id);
    if (!ended.ok()) return done(ended.status());
    // Stored, but its creator has yet to add it.
    if (!IsTerminal(ended->state)) {
      return done(absl::UnavailableError(absl::StrCat("jobs/", id,
                                                      " is being created, or was let go of after a write that was "
                                                      "refused (the server's log says why); try again")));
    }
    return done(WrongState(id, ended->state, action, needed));
  }
  const EntryPtr entry = found->second;
  if (!allowed(entry->record.state)) return done(WrongState(id, entry->record.state, action, needed));
  if (absl::Status status = CheckEtag(entry->record, etag); !status.ok()) return done(status);
  Halt(*entry);
  ChangeState(*entry, {.state = to}, std::move(done));
  if (to == JobState::kQueued) PutIntoQueue(entry);
  StartWaiting();
  Signal();
}

// mutex_ held; the entry is in the right lists already.
void Scheduler::ChangeState(Entry& entry, StateChange change, Done done) {
  JobRecord& job = entry.record;
  change.time_us = NowUs();
  --by_state_[static_cast<std::size_t>(job.state)];
  ++by_state_[static_cast<std::size_t>(change.state)];
  job.state = change.state;
  job.update_time_us = change.time_us;
  if (job.state == JobState::kRunning && job.start_time_us == 0) job.start_time_us = change.time_us;
  if (IsTerminal(job.state)) job.end_time_us = change.time_us;
  job.error_message = change.message;
  job.report = change.report;
  ++job.state_changes;
  const std::int64_t seq = ++job.last_seq;
  if (job.state != JobState::kRunning) DropRun(entry);
  store_.ChangeState(job.id, seq, change, [this, job, change, done = std::move(done)](const absl::Status& status) {
    if (status.ok()) {
      if (change.gain_set && options_.library != nullptr) AddToLibrary({&*change.gain_set, 1}, *options_.library);
      hub_.Publish(job.id, {.seq = job.last_seq, .what = change});
      if (IsTerminal(job.state)) ++metrics_.ended[static_cast<std::size_t>(job.state)];
      LogChange(job);
    } else if (!absl::IsUnavailable(status)) {
      Log(LogLevel::kError, "a change of state was refused",
          {{"job", job.id}, {"error", std::string(status.message())}});
    }
    // Nothing follows soon; who watches reads the store.
    if (IsTerminal(job.state) || job.state == JobState::kPaused) hub_.Forget(job.id);
    if (done) status.ok() ? done(job) : done(status);
  });
  if (IsTerminal(job.state)) Forget(entries_.at(job.id));
}

// mutex_ held.
void Scheduler::Fail(Entry& entry, const absl::Status& status) {
  Halt(entry);
  ChangeState(entry, {.state = JobState::kFailed, .message = std::string(status.message())}, {});
}

// mutex_ held.
void Scheduler::DropRun(Entry& entry) {
  if (entry.run != nullptr) entry.run->MarkUnwanted();
  entry.run.reset();
}

// A write that the store will never take: the job is let go of, as it is on disk, and taken up by the next start.
void Scheduler::Refused(const EntryPtr& entry, const absl::Status& status) {
  if (absl::IsUnavailable(status)) return;  // the store is being closed
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(entry->record.id);
  if (found == entries_.end() || found->second != entry) return;
  Log(LogLevel::kError, "a write was refused; the job is let go of until the next start",
      {{"job", entry->record.id}, {"error", std::string(status.message())}});
  Halt(*entry);
  DropRun(*entry);
  Forget(entry);
  StartWaiting();
  Signal();
}

}  // namespace orbitune
