// What of the scheduler waits: room for new jobs, the clients' queues, and which job begins next.
#include <algorithm>
#include <limits>

#include "server/jobs/limit.h"
#include "server/jobs/scheduler_parts.h"

namespace orbitune {
namespace {

// Every so many jobs of a client that begin, the one that has waited longest, whatever its priority.
constexpr std::uint64_t kOldestEvery = 8;

// About what an unfinished job keeps in memory.
std::int64_t FootprintOf(const JobSpec& spec) {
  std::size_t bytes = sizeof(JobRecord) + 1024 + spec.initial_conditions.size() * sizeof(OrbitState);
  bytes += spec.display_name.size() + spec.scenario.display_name.size() + spec.scenario.description.size();
  for (const auto& [key, value] : spec.labels) bytes += key.size() + value.size() + 128;
  return static_cast<std::int64_t>(bytes);
}

}  // namespace

bool Scheduler::Client::HasRoomFor(const std::string& campaign, int most_of_campaign) const {
  const auto found = of_campaign.find(campaign);
  return campaign.empty() || found == of_campaign.end() || found->second < most_of_campaign;
}

Scheduler::EntryPtr Scheduler::Client::NextWaiting(int most_of_campaign) const {
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
  auto run = JobRun::Start(entry.record);
  if (!run.ok()) return Fail(entry, run.status());
  entry.run = *std::move(run);
  if (entry.record.state == JobState::kRunning) return;  // before the last process ended
  metrics_.queue_wait_s.Observe(
      std::chrono::duration<double>(std::chrono::steady_clock::now() - entry.queued_at).count());
  ChangeState(entry, {.state = JobState::kRunning}, {});
}

}  // namespace orbitune
