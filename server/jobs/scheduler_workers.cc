// What of the scheduler runs: the workers, who is served next, and what becomes of a batch that was flown.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>

#include "core/base/nice.h"
#include "core/simd/lane_kernel.h"
#include "server/jobs/gain_sets.h"
#include "server/jobs/report.h"
#include "server/jobs/scheduler_parts.h"

namespace orbitune {
namespace {

// How long a worker looks out for the next batch of a running job before it sleeps: waking costs more than most waits
// last.
constexpr std::chrono::microseconds kLookout(50);

// Who had nothing to fly for a while catches up by no more than so many steps: a tenth of a second of a worker's time.
constexpr double kMostCredit = 200'000;

// Not yielding where there is something better: that gives the processor away to whatever has something to do, for as
// long as that has.
void SpinOnce() {
#ifdef __x86_64__
  __builtin_ia32_pause();
#else
  std::this_thread::yield();
#endif
}

// How much of the workers' time a job gets beside others of its client.
double WeightOf(const JobSpec& spec) { return std::ldexp(1.0, spec.priority); }

}  // namespace

const Scheduler::EntryPtr* Scheduler::Client::NextRunning(const Options& options) const {
  const EntryPtr* next = nullptr;
  for (const EntryPtr& entry : running) {
    if ((next == nullptr || entry->used < (*next)->used) && entry->HasWork(options)) next = &entry;
  }
  return next;
}

void Scheduler::WorkerLoop() {
  AddNice(kFlightNice);
  Lock lock(mutex_);
  Chunk chunk;
  while (AwaitChunk(chunk, lock)) {
    lock.unlock();
    const BatchUse use = chunk.run->Fly(chunk.share);
    metrics_.episodes += static_cast<std::int64_t>(chunk.share.count);
    metrics_.lane_steps += use.lane_steps;
    metrics_.used_lane_steps += use.used_lane_steps;
    lock.lock();
    Account(chunk, use);
    if (chunk.run->Finish(chunk.share) && !chunk.run->unwanted()) FinishBatch(chunk, lock);
    chunk = {};
  }
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
      while (signals_ == seen && std::chrono::steady_clock::now() < end) SpinOnce();
      lock.lock();
    }
    work_.wait(lock, [&] { return signals_ != seen; });
  }
}

// mutex_ held, so that no worker is between looking at signals_ and its sleep. There may be work, or an end to it.
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
  chunk = {.entry = *next,
           .run = entry.run,
           .share = entry.run->Claim(static_cast<std::size_t>(options_.threads)),
           .charged = entry.chunk_steps};
  const auto take = [](double& served, double& used) {
    served = std::max(served, used);
    used = std::max(used, served - kMostCredit);
  };
  take(served_, entry.client->used);
  take(entry.client->served, entry.used);
  Charge(entry, chunk.charged);
  return true;
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

void Scheduler::FinishBatch(const Chunk& last, Lock& lock) {
  Entry& entry = *last.entry;
  JobRun& run = *last.run;
  if (run.searching()) {
    // The run is this worker's alone: every episode is claimed.
    lock.unlock();
    BatchOutcome outcome = run.FinishSearchBatch();
    lock.lock();
    // Else paused or cancelled meanwhile, or the scheduler stops: what it flew for a message may have been broken off.
    if (entry.run == last.run && !run.unwanted()) FinishIterations(entry, run, std::move(outcome));
  } else if (entry.run == last.run) {
    FinishReport(entry, run);
  }
  Signal();
}

// mutex_ held.
void Scheduler::FinishIterations(Entry& entry, JobRun& run, BatchOutcome outcome) {
  for (BatchOutcome::Iteration& i : outcome.iterations) Append(entry, std::move(i.record), std::move(i.continuation));
  if (!outcome.status.ok()) {
    Fail(entry, outcome.status);
    return StartWaiting();
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
void Scheduler::FinishReport(Entry& entry, JobRun& run) {
  StateChange change{.state = JobState::kSucceeded};
  change.report = BuildReport(entry.record, run.prepared(), run.results(), entry.pairs_left_out);
  change.gain_set =
      MakeGainSet(entry.record, run.prepared().front(), *change.report, run.lyapunov_decreasing(), NowUs());
  Halt(entry);
  ChangeState(entry, std::move(change), {});
  StartWaiting();
}

void Scheduler::Committed(const EntryPtr& entry) {
  const std::lock_guard lock(mutex_);
  if (entry->uncommitted-- == options_.max_uncommitted_iterations) Signal();
}

}  // namespace orbitune
