#include "server/jobs/scheduler.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/library/history_digest.h"
#include "core/search/ensemble_search.h"
#include "core/simd/batch_simulator.h"
#include "core/simd/engine.h"
#include "core/simd/lane_kernel.h"
#include "server/jobs/gain_sets.h"
#include "server/jobs/limit.h"
#include "server/jobs/report.h"
#include "server/log/log.h"
#include "storage/serialise.h"

namespace orbitune {

namespace {

// What a job takes in its turn however large its batches, so that a small job beside it gets on, and a stop waits for
// little; some times the lanes of the widest vector, so that they are used.
constexpr std::size_t kLargestChunk = 64;

// Iterations that take less may put episodes off; records are then late by no more than a few times this.
constexpr std::chrono::milliseconds kQuickIteration(5);

// How long a worker looks out for the next batch of a running job before it sleeps: waking costs more than most waits
// last.
constexpr std::chrono::microseconds kLookout(50);

// Every so many jobs of a client that begin, the one that has waited longest, whatever its priority.
constexpr std::uint64_t kOldestEvery = 8;

// Who had nothing to fly for a while catches up by no more than so many steps: a tenth of a second of a worker's time.
constexpr double kMostCredit = 200'000;

// How much of the workers' time a job gets beside others of its client.
double WeightOf(const JobSpec& spec) { return std::ldexp(1.0, spec.priority); }

// About what an unfinished job keeps in memory.
std::int64_t FootprintOf(const JobSpec& spec) {
  std::size_t bytes = sizeof(JobRecord) + 1024 + spec.initial_conditions.size() * sizeof(OrbitState);
  bytes += spec.display_name.size() + spec.scenario.display_name.size() + spec.scenario.description.size();
  for (const auto& [key, value] : spec.labels) bytes += key.size() + value.size() + 128;
  return static_cast<std::int64_t>(bytes);
}

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

}  // namespace

TimeUs NowUs() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

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

// What a batch brought: iterations in order, and the error that ends the search, if one does.
struct Scheduler::BatchOutcome {
  struct Iteration {
    IterationRecord record;
    Continuation continuation;
  };
  std::vector<Iteration> iterations;
  absl::Status status;
};

// One batch after the other: the search's iterations, then the report's three episodes. Everything but what `claimed`
// and `finished` count is touched by one worker at a time: the one that ended the batch.
//
// Of ARS, nothing waits for the episode of K(i) itself but the record. While iterations are quick these episodes are
// put off until there are enough of them to fill a vector: one of them alone would cost the lanes of a whole one.
struct Scheduler::Run {
  // prepared: of each initial condition.
  explicit Run(std::vector<PreparedScenario> p) : prepared(std::move(p)) {}

  // To be called once, first.
  absl::Status Start(const JobRecord& record) {
    search.emplace(record.spec.scenario.search, record.spec.objective, prepared.size());
    digest = record.provenance->digest;
    const std::vector<EngineStretch>& engines = record.provenance->engines;
    if (engines.empty() || engines.back().engine != CurrentEngine()) new_engine = CurrentEngine();
    if (!record.latest) return absl::OkStatus();
    replayed = record.latest;
    return search->Resume(*record.latest, record.checkpoint);
  }

  std::atomic<bool> unwanted = false;  // by anybody: what it still flies may be broken off
  const std::vector<PreparedScenario> prepared;
  std::optional<EnsembleSearch> search;     // none in the report
  std::optional<IterationRecord> replayed;  // the first iteration must come out as this stored one
  Digest digest{};                          // of the newest iteration that is complete
  std::optional<Engine> new_engine;         // to be stored with the next one
  std::vector<Gains> report_gains;

  // The batch: the search's episodes but the first `put_off`, then those of `late`.
  std::vector<EpisodeResult> results;
  std::size_t searched = 0;                      // results before those of `late`
  std::size_t put_off = 0;                       // 0 or 1
  std::vector<BatchOutcome::Iteration> late;     // all but their own episode, which the batch flies
  std::size_t claimed = 0;                       // put_off included
  std::atomic<bool> lyapunov_decreasing = true;  // under the report's last gains, the best
  std::size_t finished = 0;
  std::chrono::steady_clock::time_point begun;

  std::vector<BatchOutcome::Iteration> incomplete;  // those of earlier batches that no batch flies yet
  bool updated = false;                             // since the start

  BatchEpisode EpisodeAt(std::size_t e) const {
    if (e >= searched) return {.problem = &prepared[0].problem, .gains = late[e - searched].record.gains};
    return {.problem = &prepared[search->initial_condition(e)].problem, .gains = search->gains(e)};
  }

  // The report's episodes go the whole horizon and have their effort measured.
  BatchUse Simulate(std::size_t begin, std::size_t count) {
    const auto cancelled = [this] { return unwanted.load(std::memory_order_relaxed); };
    const std::span<EpisodeResult> out = std::span(results).subspan(begin, count);
    if (search) {
      std::vector<BatchEpisode> episodes;
      for (std::size_t e = begin; e < begin + count; ++e) episodes.push_back(EpisodeAt(e));
      return SimulateBatch(episodes, out, cancelled);
    }
    BatchUse use;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t e = begin + i;
      const WatchedEpisode episode =
          FlyWatched(prepared[e % prepared.size()].problem, report_gains[e / prepared.size()],
                     {.early_exit = false, .cancelled = cancelled});
      out[i] = episode.result;
      use.scalar_steps += out[i].steps + out[i].rejected_steps;
      if (!episode.lyapunov_decreasing && e / prepared.size() + 1 == report_gains.size()) lyapunov_decreasing = false;
    }
    return use;
  }

  // After a batch of the search.
  BatchOutcome FinishSearchBatch() {
    BatchOutcome outcome = LearnFromBatch();
    for (BatchOutcome::Iteration& f : outcome.iterations) {
      // The digest has the replayed one already.
      if (replayed && f.record.iteration == replayed->iteration) continue;
      digest = f.continuation.digest = ExtendHistory(digest, f.record);
      f.continuation.engine = std::exchange(new_engine, std::nullopt);
    }
    return outcome;
  }

  BatchOutcome LearnFromBatch() {
    BatchOutcome outcome;
    for (std::size_t i = 0; i < late.size(); ++i) SetEpisode(results[searched + i], late[i].record);
    outcome.iterations = std::exchange(late, {});
    if (searched == 0) return outcome;
    std::vector<double> checkpoint = search->checkpoint();
    const Gains first = search->gains(0);
    const auto record = search->Update(std::span(results).first(searched));
    updated = true;
    if (!record.ok()) {
      // The message tells of the first episode.
      if (put_off > 0) FlyAtOnce(first, results[0]);
      for (BatchOutcome::Iteration& f : incomplete) {
        EpisodeResult own;
        FlyAtOnce(f.record.gains, own);
        SetEpisode(own, f.record);
        outcome.iterations.push_back(std::move(f));
      }
      incomplete.clear();
      outcome.status = record.status();
      return outcome;
    }
    (put_off > 0 ? incomplete : outcome.iterations).push_back({*record, {.checkpoint = std::move(checkpoint)}});
    return outcome;
  }

  void FlyAtOnce(const Gains& gains, EpisodeResult& result) const {
    const BatchEpisode episode{.problem = &prepared[0].problem, .gains = gains};
    SimulateBatch({&episode, 1}, {&result, 1}, [this] { return unwanted.load(std::memory_order_relaxed); });
  }

  // Why there is no cost under the first gains of the batch; empty if there is one.
  std::string DescribeFirst() const {
    for (std::size_t i = 0; i < prepared.size(); ++i) {
      if (HasCost(results[i].outcome)) continue;
      const std::string from = prepared.size() == 1 ? "" : absl::StrCat("from initial condition ", i, ", ");
      return absl::StrCat("Under K(", search->iteration(), "): ", from, DescribeOutcome(results[i], prepared[i]));
    }
    return "";
  }

  void NextBatch(const JobRecord& record) {
    const bool searching = search && (!updated || !search->done());
    if (!searching && incomplete.empty()) search.reset();
    const auto now = std::chrono::steady_clock::now();
    put_off = searching && updated && now - begun < kQuickIteration && search->first_is_for_the_record() ? 1 : 0;
    begun = now;
    if (put_off == 0 || incomplete.size() >= simd::LaneCount()) late = std::exchange(incomplete, {});
    if (!search) report_gains = {record.first->gains, record.latest->gains, record.best->gains};
    searched = searching ? search->episodes() : search ? 0 : report_gains.size() * prepared.size();
    results.assign(searched + late.size(), {});
    claimed = finished = put_off;
  }
};

struct Scheduler::Entry {
  Entry(JobRecord r, ClientPtr c) : record(std::move(r)), client(std::move(c)) {
    ORBITUNE_CHECK(record.provenance.has_value());
  }

  JobRecord record;  // as of the newest event queued at the store
  const ClientPtr client;
  std::shared_ptr<Run> run;
  std::int64_t pairs_left_out = 0;
  int uncommitted = 0;

  // While it waits.
  struct Place {
    int rank = 0;  // the highest priority has the least
    std::uint64_t order = 0;
    auto operator<=>(const Place&) const = default;
  };
  std::optional<Place> place;
  std::chrono::steady_clock::time_point queued_at;

  // In steps of the integrator, of a vector of episodes or of one: what the workers' time goes into, whatever the clock
  // says of it.
  double used = 0;         // over its weight
  double chunk_steps = 0;  // what a chunk of it took lately

  bool HasWork(const Options& options) const {
    return run != nullptr && run->claimed < run->results.size() && uncommitted < options.max_uncommitted_iterations;
  }
};

struct Scheduler::Client {
  // Of one campaign's jobs, or of those that are part of none: by place, and by age alone.
  struct Queue {
    std::map<Entry::Place, EntryPtr> by_place;
    std::map<std::uint64_t, EntryPtr> by_age;
  };

  std::vector<EntryPtr> running;
  std::map<std::string, Queue> waiting;    // by campaign; none is empty
  std::map<std::string, int> of_campaign;  // running jobs of each
  std::uint64_t begun = 0;                 // jobs so far
  std::uint64_t last_begun = 0;            // the number of the last one among all clients'
  int jobs = 0;                            // unfinished, and room for some
  int of_no_campaign = 0;                  // of them
  std::int64_t job_bytes = 0;              // of them
  double used = 0;                         // of the workers' time
  double served = 0;                       // what its job served last had had

  bool HasRoomFor(const std::string& campaign, int most_of_campaign) const {
    const auto found = of_campaign.find(campaign);
    return campaign.empty() || found == of_campaign.end() || found->second < most_of_campaign;
  }

  // The one to begin next; nullptr where none may.
  EntryPtr NextWaiting(int most_of_campaign) const {
    const bool oldest = begun % kOldestEvery == kOldestEvery - 1;
    EntryPtr next;
    for (const auto& [campaign, queue] : waiting) {
      if (!HasRoomFor(campaign, most_of_campaign)) continue;
      const EntryPtr& first = oldest ? queue.by_age.begin()->second : queue.by_place.begin()->second;
      const bool before =
          next == nullptr || (oldest ? first->place->order < next->place->order : *first->place < *next->place);
      if (before) next = first;
    }
    return next;
  }

  // The running job to be served next; nullptr where none has work.
  const EntryPtr* NextRunning(const Options& options) const {
    const EntryPtr* next = nullptr;
    for (const EntryPtr& entry : running) {
      if ((next == nullptr || entry->used < (*next)->used) && entry->HasWork(options)) next = &entry;
    }
    return next;
  }
};

struct Scheduler::Chunk {
  EntryPtr entry;
  std::shared_ptr<Run> run;
  std::size_t begin = 0;
  std::size_t count = 0;
  double charged = 0;  // for it, before it was flown
};

namespace {

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

Scheduler::Scheduler(JobStore& store, EventHub& hub, Options options) : store_(store), hub_(hub), options_(options) {
  ORBITUNE_CHECK(options.threads > 0 && options.max_running_jobs > 0 && options.max_uncommitted_iterations > 0);
}

Scheduler::~Scheduler() { Stop(); }

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
      if (entry->run != nullptr) entry->run->unwanted = true;
    }
  }
  Signal();
  for (std::thread& worker : workers_) worker.join();
  workers_.clear();
  store_.Flush();  // its callbacks point here
}

Scheduler::Room& Scheduler::Room::operator=(Room&& other) noexcept {
  std::swap(scheduler_, other.scheduler_);
  std::swap(client_, other.client_);
  std::swap(jobs_, other.jobs_);
  std::swap(of_no_campaign_, other.of_no_campaign_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

Scheduler::Room::~Room() {
  if (scheduler_ == nullptr) return;
  const std::lock_guard lock(scheduler_->mutex_);
  scheduler_->queued_ -= jobs_;
  const ClientPtr client = scheduler_->clients_.at(client_);
  scheduler_->Count(*client, -jobs_, -of_no_campaign_, -bytes_);
  if (client->jobs == 0) scheduler_->clients_.erase(client_);
}

absl::StatusOr<Scheduler::Room> Scheduler::Reserve(const JobSpec& spec, int jobs) {
  const JobLimits& limits = options_.limits;
  const std::int64_t bytes = jobs * FootprintOf(spec);
  const std::lock_guard lock(mutex_);
  const auto found = clients_.find(ClientOf(spec));
  const Client none;
  const Client& client = found == clients_.end() ? none : *found->second;
  constexpr std::string_view kLater = "try again when some have begun or ended";
  if (queued_ + jobs > limits.max_queued_jobs) {
    return LimitExceeded("jobs waiting to begin", {"max-queued-jobs", limits.max_queued_jobs}, kLater);
  }
  if (client.jobs + jobs > (limits.max_queued_jobs + 1) / 2) {
    return LimitExceeded("unfinished jobs of one client, campaigns' included: half of what may wait in all",
                         {"max-queued-jobs", limits.max_queued_jobs}, kLater);
  }
  if (spec.campaign_id.empty() && client.of_no_campaign + jobs > limits.max_jobs_per_client) {
    return LimitExceeded("unfinished jobs of one client", {"max-jobs-per-client", limits.max_jobs_per_client}, kLater);
  }
  if (job_bytes_ + bytes > limits.max_job_memory_bytes || client.job_bytes + bytes > limits.max_job_memory_bytes / 2) {
    return LimitExceeded("MiB of memory for unfinished jobs, a client's being half of that",
                         {"max-job-memory-mib", limits.max_job_memory_bytes >> 20}, kLater);
  }
  Room room;
  room.scheduler_ = this;
  room.client_ = ClientOf(spec);
  room.jobs_ = jobs;
  room.of_no_campaign_ = spec.campaign_id.empty() ? jobs : 0;
  room.bytes_ = bytes;
  ClientPtr& counted = clients_[room.client_];
  if (counted == nullptr) counted = std::make_shared<Client>();
  queued_ += jobs;
  Count(*counted, jobs, room.of_no_campaign_, bytes);
  return room;
}

void Scheduler::Add(const JobRecord& created) {
  {
    const std::lock_guard lock(mutex_);
    // A repeated request may bring a job that is here already.
    if (entries_.contains(created.id)) return;
    PutIntoQueue(AddEntry(created));
    StartWaiting();
  }
  Signal();
}

JobCounts Scheduler::counts() {
  const std::lock_guard lock(mutex_);
  const auto in = [this](JobState state) { return by_state_[static_cast<std::size_t>(state)]; };
  return {.queued = in(JobState::kQueued), .running = in(JobState::kRunning), .paused = in(JobState::kPaused)};
}

// mutex_ held.
void Scheduler::Count(Client& client, int jobs, int of_no_campaign, std::int64_t bytes) {
  client.jobs += jobs;
  client.of_no_campaign += of_no_campaign;
  client.job_bytes += bytes;
  job_bytes_ += bytes;
}

// mutex_ held.
Scheduler::EntryPtr Scheduler::AddEntry(JobRecord record) {
  ClientPtr& client = clients_[ClientOf(record.spec)];
  if (client == nullptr) client = std::make_shared<Client>();
  Count(*client, 1, record.spec.campaign_id.empty() ? 1 : 0, FootprintOf(record.spec));
  auto entry = std::make_shared<Entry>(std::move(record), client);
  entries_.emplace(entry->record.id, entry);
  ++by_state_[static_cast<std::size_t>(entry->record.state)];
  return entry;
}

// mutex_ held.
void Scheduler::Forget(EntryPtr entry) {
  const JobSpec& spec = entry->record.spec;
  entries_.erase(entry->record.id);
  --by_state_[static_cast<std::size_t>(entry->record.state)];
  Count(*entry->client, -1, spec.campaign_id.empty() ? -1 : 0, -FootprintOf(spec));
  if (entry->client->jobs == 0) clients_.erase(ClientOf(spec));
}

// mutex_ held. One that ran when the last process ended goes before those that had not begun.
void Scheduler::PutIntoQueue(const EntryPtr& entry) {
  const JobSpec& spec = entry->record.spec;
  const int rank = entry->record.state == JobState::kRunning ? std::numeric_limits<int>::min() : -spec.priority;
  entry->place = {.rank = rank, .order = next_order_++};
  entry->queued_at = std::chrono::steady_clock::now();
  Client::Queue& queue = entry->client->waiting[spec.campaign_id];
  queue.by_place.emplace(*entry->place, entry);
  queue.by_age.emplace(entry->place->order, entry);
  ++queued_;
}

// mutex_ held. Takes it out of what runs or waits.
void Scheduler::Halt(Entry& entry) {
  Client& client = *entry.client;
  const std::string& campaign = entry.record.spec.campaign_id;
  if (entry.place) {
    const auto queue = client.waiting.find(campaign);
    queue->second.by_place.erase(*entry.place);
    queue->second.by_age.erase(entry.place->order);
    if (queue->second.by_age.empty()) client.waiting.erase(queue);
    entry.place.reset();
    --queued_;
  } else if (std::erase_if(client.running, [&](const EntryPtr& e) { return e.get() == &entry; }) > 0) {
    if (--client.of_campaign.at(campaign) == 0) client.of_campaign.erase(campaign);
    --running_;
  }
}

// mutex_ held. nullptr where none may begin. Of one campaign only so many run at a time, so that it neither takes all
// the room nor ends all its jobs at once; those behind them pass.
Scheduler::EntryPtr Scheduler::TakeFromQueue() {
  const int most_of_campaign =
      options_.max_running_of_campaign > 0 ? options_.max_running_of_campaign : std::max(4, 2 * options_.threads);
  EntryPtr next;
  for (const auto& [name, client] : clients_) {
    if (client->waiting.empty()) continue;
    if (running_ >= options_.max_running_jobs * (client->running.empty() ? 2 : 1)) continue;
    const auto turn = [](const Client& c) { return std::pair(c.running.size(), c.last_begun); };
    if (next != nullptr && turn(*client) >= turn(*next->client)) continue;
    if (EntryPtr of_client = client->NextWaiting(most_of_campaign)) next = std::move(of_client);
  }
  if (next != nullptr) Halt(*next);
  return next;
}

// mutex_ held.
void Scheduler::StartWaiting() {
  while (const EntryPtr entry = TakeFromQueue()) {
    Client& client = *entry->client;
    // What others had meanwhile is theirs.
    if (client.running.empty()) client.used = std::max(client.used, served_);
    entry->used = std::max(entry->used, client.served);
    client.running.push_back(entry);
    ++client.of_campaign[entry->record.spec.campaign_id];
    ++running_;
    ++client.begun;
    client.last_begun = ++begun_;
    Begin(*entry);
  }
}

// mutex_ held.
void Scheduler::Begin(Entry& entry) {
  const auto fail = [&](const absl::Status& status) {
    Halt(entry);
    ChangeState(entry, {.state = JobState::kFailed, .message = std::string(status.message())}, {});
  };
  // The spec was validated when the job was created.
  std::vector<PreparedScenario> prepared;
  for (const OrbitState& start : entry.record.spec.starts()) {
    auto one = Prepare(entry.record.spec.scenario, start);
    if (!one.ok()) return fail(one.status());
    prepared.push_back(*std::move(one));
  }
  auto run = std::make_shared<Run>(std::move(prepared));
  if (absl::Status status = run->Start(entry.record); !status.ok()) return fail(status);
  entry.run = std::move(run);
  entry.run->NextBatch(entry.record);
  if (entry.record.state == JobState::kRunning) return;  // before the last process ended
  metrics_.queue_wait_s.Observe(
      std::chrono::duration<double>(std::chrono::steady_clock::now() - entry.queued_at).count());
  ChangeState(entry, {.state = JobState::kRunning}, {});
}

void Scheduler::WorkerLoop() {
  Lock lock(mutex_);
  Chunk chunk;
  while (AwaitChunk(chunk, lock)) {
    lock.unlock();
    const BatchUse use = chunk.run->Simulate(chunk.begin, chunk.count);
    metrics_.episodes += static_cast<std::int64_t>(chunk.count);
    metrics_.lane_steps += use.lane_steps;
    metrics_.used_lane_steps += use.used_lane_steps;
    lock.lock();
    Account(chunk, use);
    chunk.run->finished += chunk.count;
    if (chunk.run->finished == chunk.run->results.size() && !chunk.run->unwanted) FinishBatch(chunk, lock);
    chunk = {};
  }
}

// mutex_ held.
void Scheduler::Charge(Entry& entry, double steps) {
  entry.used += steps / WeightOf(entry.record.spec);
  entry.client->used += steps;
}

// mutex_ held. A chunk is charged for as it is taken, by what they took lately, so that other threads see it; here by
// what it really took.
void Scheduler::Account(const Chunk& chunk, const BatchUse& use) {
  const double steps = static_cast<double>(use.lane_steps) / static_cast<double>(simd::LaneCount()) +
                       static_cast<double>(use.scalar_steps);
  Entry& entry = *chunk.entry;
  Charge(entry, steps - chunk.charged);
  entry.chunk_steps = entry.chunk_steps == 0 ? steps : 0.75 * entry.chunk_steps + 0.25 * steps;
}

// False: the scheduler is stopping.
bool Scheduler::AwaitChunk(Chunk& chunk, Lock& lock) {
  while (true) {
    if (stopping_) return false;
    if (NextChunk(chunk)) return true;
    const std::uint64_t seen = signals_;
    if (running_ > 0) {
      lock.unlock();
      const auto end = std::chrono::steady_clock::now() + kLookout;
      while (signals_ == seen && std::chrono::steady_clock::now() < end) std::this_thread::yield();
      lock.lock();
    }
    work_.wait(lock, [&] { return signals_ != seen; });
  }
}

// There may be work, or an end to it. To be called after a change under mutex_.
void Scheduler::Signal() {
  ++signals_;
  work_.notify_all();
}

// mutex_ held.
bool Scheduler::NextChunk(Chunk& chunk) {
  const EntryPtr* next = nullptr;
  for (const auto& [name, client] : clients_) {
    if (next != nullptr && client->used >= (*next)->client->used) continue;
    if (const EntryPtr* of_client = client->NextRunning(options_)) next = of_client;
  }
  if (next == nullptr) return false;
  Entry& entry = **next;
  Run& run = *entry.run;
  // An equal share of the batch for each worker, so that a single job has all of them; in whole vectors.
  const std::size_t threads = static_cast<std::size_t>(options_.threads);
  const std::size_t lanes = simd::LaneCount();
  const std::size_t share = (run.results.size() - run.put_off + threads * lanes - 1) / (threads * lanes) * lanes;
  chunk = {.entry = *next,
           .run = entry.run,
           .begin = run.claimed,
           .count = std::min({share, kLargestChunk, run.results.size() - run.claimed}),
           .charged = entry.chunk_steps};
  run.claimed += chunk.count;
  const auto take = [](double& served, double& used) {
    served = std::max(served, used);
    used = std::max(used, served - kMostCredit);
  };
  take(served_, entry.client->used);
  take(entry.client->served, entry.used);
  Charge(entry, chunk.charged);
  return true;
}

void Scheduler::FinishBatch(const Chunk& last, Lock& lock) {
  Entry& entry = *last.entry;
  Run& run = *last.run;
  if (run.search) {
    // The run is this worker's alone: every episode is claimed.
    lock.unlock();
    BatchOutcome outcome = run.FinishSearchBatch();
    lock.lock();
    // Else paused or cancelled meanwhile, or the scheduler stops: what it flew for a message may have been broken off.
    if (entry.run == last.run && !run.unwanted) FinishIterations(entry, run, std::move(outcome));
  } else if (entry.run == last.run) {
    FinishReport(entry, run);
  }
  Signal();
}

// mutex_ held.
void Scheduler::FinishIterations(Entry& entry, Run& run, BatchOutcome outcome) {
  const auto fail = [&](std::string message) {
    Halt(entry);
    ChangeState(entry, {.state = JobState::kFailed, .message = std::move(message)}, {});
    StartWaiting();
  };
  for (BatchOutcome::Iteration& f : outcome.iterations) {
    if (!run.replayed) {
      Append(entry, std::move(f.record), std::move(f.continuation));
      continue;
    }
    if (!Identical(*run.replayed, f.record)) {
      return fail(absl::StrCat("iteration ", f.record.iteration,
                               ", run again to go on from it, differs from the one stored: this server's numerics are "
                               "not those that the job was begun with"));
    }
    run.replayed.reset();
  }
  if (!outcome.status.ok()) {
    std::string message(outcome.status.message());
    if (const std::string first = run.DescribeFirst(); !first.empty()) absl::StrAppend(&message, ". ", first);
    return fail(std::move(message));
  }
  run.NextBatch(entry.record);
}

// mutex_ held.
void Scheduler::Append(Entry& entry, IterationRecord record, Continuation continuation) {
  JobRecord& job = entry.record;
  const EntryPtr self = entries_.at(job.id);
  const std::int64_t seq = ++job.last_seq;
  if (!job.first) job.first = record;
  if (!job.best || Better(record, *job.best)) job.best = record;
  job.latest = record;
  job.checkpoint = continuation.checkpoint;
  job.provenance->digest = continuation.digest;
  if (continuation.engine) job.provenance->engines.push_back({record.iteration, *continuation.engine});
  entry.pairs_left_out += record.pairs_left_out;
  ++entry.uncommitted;
  const auto done = [this, self, id = job.id, seq, record](const absl::Status& s) {
    if (s.ok()) {
      hub_.Publish(id, {.seq = seq, .what = record});
      ++metrics_.iterations;
    } else {
      Refused(self, s);
    }
    Committed(self);
  };
  store_.AppendIteration(job.id, seq, record, std::move(continuation), done);
}

// mutex_ held.
void Scheduler::FinishReport(Entry& entry, Run& run) {
  StateChange change{.state = JobState::kSucceeded};
  change.report = BuildReport(entry.record, run.prepared, run.results, entry.pairs_left_out);
  change.gain_set = MakeGainSet(entry.record, run.prepared.front(), *change.report, run.lyapunov_decreasing, NowUs());
  Halt(entry);
  ChangeState(entry, std::move(change), {});
  StartWaiting();
}

// mutex_ held.
void Scheduler::DropRun(Entry& entry) {
  if (entry.run != nullptr) entry.run->unwanted = true;
  entry.run.reset();
}

void Scheduler::Committed(const EntryPtr& entry) {
  {
    const std::lock_guard lock(mutex_);
    if (entry->uncommitted-- < options_.max_uncommitted_iterations) return;
  }
  Signal();
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
  lock.unlock();
  Signal();
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

}  // namespace orbitune
