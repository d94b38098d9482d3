#include "server/jobs/campaign_engine.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <future>
#include <latch>
#include <set>

#include "absl/strings/str_cat.h"
#include "core/base/nice.h"
#include "server/jobs/campaign_results.h"
#include "server/jobs/gain_sets.h"
#include "server/jobs/limit.h"
#include "server/log/log.h"
#include "storage/serialise.h"

namespace orbitune {
namespace {

constexpr TimeUs kBetweenProgressUs = 250'000;
constexpr std::chrono::seconds kBeforeReadingAgain{1};
constexpr int kPage = 1000;

// Waits for the answer of one write.
template <typename T, typename Write>
T Await(const Write& write) {
  std::promise<T> answer;
  write([&answer](T value) { answer.set_value(std::move(value)); });
  return answer.get_future().get();
}

absl::Status WrongCampaignState(const std::string& id, CampaignState state, std::string_view action,
                                std::string_view needed) {
  return WithReason(absl::FailedPreconditionError(absl::StrCat("campaigns/", id, " is ", ToAbsl(NameOf(state)), "; to ",
                                                               ToAbsl(action), " it, it must be ", ToAbsl(needed))),
                    "CAMPAIGN_STATE");
}

absl::Status CheckCampaignEtag(const std::string& id, std::int64_t state_changes, const std::string& etag) {
  CampaignRecord record;
  record.id = id;
  record.state_changes = state_changes;
  if (etag.empty() || etag == EtagOf(record)) return absl::OkStatus();
  return WithReason(absl::AbortedError(absl::StrCat("etag: campaigns/", id, " has changed: its etag is ",
                                                    EtagOf(record), ", got ", FormatReceived(etag))),
                    "ETAG_MISMATCH");
}

absl::StatusOr<std::vector<CampaignMember>> AllMembers(const CampaignStore& store, const std::string& id) {
  std::vector<CampaignMember> all;
  while (true) {
    auto page = store.ListMembers(id, all.empty() ? MemberId{} : all.back().id, kPage);
    if (!page.ok()) return page.status();
    all.insert(all.end(), std::make_move_iterator(page->begin()), std::make_move_iterator(page->end()));
    if (page->size() < static_cast<std::size_t>(kPage)) return all;
  }
}

// The members whose jobs' ends are in the campaign's sequence.
absl::StatusOr<std::set<MemberId>> EndedMembers(const CampaignStore& store, const std::string& id) {
  std::set<MemberId> ended;
  for (std::int64_t after = 0;;) {
    const auto events = store.ListCampaignEvents(id, after, kPage);
    if (!events.ok()) return events.status();
    if (events->empty()) return ended;
    after = events->back().seq;
    for (const CampaignEvent& event : *events) {
      if (const auto* end = std::get_if<MemberEnded>(&event.what)) ended.insert(end->member);
    }
  }
}

}  // namespace

std::string EtagOf(const CampaignRecord& record) { return absl::StrCat(record.id, "-", record.state_changes); }

// An unfinished campaign, as of the newest event queued at the store. Guarded by mutex_, but for what is atomic.
struct CampaignEngine::Entry {
  explicit Entry(const CampaignRecord& record)
      : id(record.id),
        client(ClientOf(record.spec)),
        state(record.state),
        last_seq(record.last_seq),
        state_changes(record.state_changes) {}

  const std::string id;
  const std::string client;
  CampaignState state;
  std::int64_t last_seq;
  std::int64_t state_changes;
  std::map<std::string, MemberId> jobs;  // that have not ended
  std::atomic<bool> unwanted = false;    // nobody waits for its comparison any more
  TimeUs last_progress_us = 0;
};

CampaignEngine::Subscription& CampaignEngine::Subscription::operator=(Subscription&& other) noexcept {
  std::swap(engine_, other.engine_);
  std::swap(id_, other.id_);
  std::swap(key_, other.key_);
  return *this;
}

CampaignEngine::Subscription::~Subscription() {
  if (engine_ == nullptr) return;
  const std::lock_guard lock(engine_->watchers_mutex_);
  const auto watchers = engine_->watchers_.find(id_);
  watchers->second.erase(key_);
  if (watchers->second.empty()) engine_->watchers_.erase(watchers);
}

CampaignEngine::CampaignEngine(JobStore& jobs, CampaignStore& store, Scheduler& scheduler, EventHub& hub,
                               GainLibrary* library, int max_campaigns_per_client)
    : jobs_(jobs),
      store_(store),
      scheduler_(scheduler),
      hub_(hub),
      library_(library),
      max_campaigns_per_client_(max_campaigns_per_client) {
  hub_.SetObserver([this](const std::string& job_id, const JobEvent& event) { OnJobEvent(job_id, event); });
}

CampaignEngine::~CampaignEngine() {
  Stop();
  hub_.SetObserver({});
}

absl::Status CampaignEngine::Start() {
  const std::lock_guard transition(transitions_);
  std::vector<JobRecord> members;
  {
    const std::lock_guard lock(mutex_);
    const auto campaigns = store_.ListUnfinishedCampaigns();
    if (!campaigns.ok()) return campaigns.status();
    auto unfinished = jobs_.ListUnfinishedJobs();
    if (!unfinished.ok()) return unfinished.status();
    std::map<std::string, JobRecord> by_id;
    for (JobRecord& job : *unfinished) {
      if (job.spec.campaign_id.empty()) continue;
      members.push_back(job);
      by_id.emplace(job.id, std::move(job));
    }
    for (const CampaignRecord& campaign : *campaigns) {
      if (absl::Status status = TakeUp(campaign, by_id); !status.ok()) return status;
    }
  }
  TellJobs(members);
  evaluator_ = std::thread([this] { EvaluateLoop(); });
  return absl::OkStatus();
}

// mutex_ held. Jobs that ended when nobody was there to note it are noted now.
absl::Status CampaignEngine::TakeUp(const CampaignRecord& record, const std::map<std::string, JobRecord>& unfinished) {
  const auto members = AllMembers(store_, record.id);
  if (!members.ok()) return members.status();
  const auto noted = EndedMembers(store_, record.id);
  if (!noted.ok()) return noted.status();
  std::vector<std::pair<std::string, MemberId>> jobs;
  for (const CampaignMember& member : *members) {
    if (!member.job_id.empty() && !noted->contains(member.id)) jobs.emplace_back(member.job_id, member.id);
  }
  AddEntry(record, jobs);
  const EntryPtr entry = entries_.at(record.id);
  for (const auto& [job_id, member] : jobs) {
    if (unfinished.contains(job_id)) continue;
    const auto job = jobs_.GetJob(job_id);
    if (!job.ok()) return job.status();
    if (IsTerminal(job->state)) JobEnded(entry, job_id, job->state, job->end_time_us);
  }
  if (!entry->jobs.empty()) return absl::OkStatus();
  if (entry->state == CampaignState::kEvaluating) {
    if (std::ranges::find(evaluations_, entry) == evaluations_.end()) evaluations_.push_back(entry);
  } else if (entry->state == CampaignState::kRunning) {
    BeginEvaluation(entry);
  }
  return absl::OkStatus();
}

// What a crash may have kept from them.
void CampaignEngine::TellJobs(const std::vector<JobRecord>& unfinished) {
  std::vector<std::string> to_pause, to_resume, to_cancel;
  for (const JobRecord& job : unfinished) {
    const auto campaign = store_.GetCampaign(job.spec.campaign_id);
    if (!campaign.ok()) continue;
    const bool paused = job.state == JobState::kPaused;
    if (campaign->state == CampaignState::kPaused && !paused) to_pause.push_back(job.id);
    if (campaign->state == CampaignState::kRunning && paused) to_resume.push_back(job.id);
    if (campaign->state == CampaignState::kCancelled) to_cancel.push_back(job.id);
  }
  Steer(to_pause, &Scheduler::Pause);
  Steer(to_resume, &Scheduler::Resume);
  Steer(to_cancel, &Scheduler::Cancel);
}

void CampaignEngine::Stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    for (const auto& [id, entry] : entries_) entry->unwanted = true;
  }
  to_evaluate_.notify_all();
  if (evaluator_.joinable()) evaluator_.join();
  jobs_.Flush();  // its callbacks point here
}

// mutex_ held.
void CampaignEngine::AddEntry(const CampaignRecord& record, const std::vector<std::pair<std::string, MemberId>>& jobs) {
  auto entry = std::make_shared<Entry>(record);
  entry->jobs.insert(jobs.begin(), jobs.end());
  entries_[record.id] = entry;
  for (const auto& [job_id, member] : jobs) by_job_[job_id] = entry;
}

// mutex_ held.
void CampaignEngine::RemoveEntry(const std::string& id) {
  const auto found = entries_.find(id);
  found->second->unwanted = true;
  for (const auto& [job_id, member] : found->second->jobs) by_job_.erase(job_id);
  entries_.erase(found);
}

void CampaignEngine::OnJobEvent(const std::string& job_id, const JobEvent& event) {
  const std::lock_guard lock(mutex_);
  const auto found = by_job_.find(job_id);
  if (found == by_job_.end()) return;
  const EntryPtr entry = found->second;
  const auto* change = std::get_if<StateChange>(&event.what);
  if (change != nullptr && IsTerminal(change->state)) return JobEnded(entry, job_id, change->state, change->time_us);
  const TimeUs now = NowUs();
  if (now - entry->last_progress_us < kBetweenProgressUs) return;
  entry->last_progress_us = now;
  WakeWatchers(entry->id);
}

// mutex_ held.
void CampaignEngine::JobEnded(const EntryPtr& entry, const std::string& job_id, JobState state, TimeUs time_us) {
  const auto job = entry->jobs.find(job_id);
  const MemberEnded ended{.member = job->second, .job_id = job_id, .state = state, .time_us = time_us};
  entry->jobs.erase(job);
  by_job_.erase(job_id);
  store_.AppendMemberEnded(entry->id, ++entry->last_seq, ended, [this, id = entry->id](const absl::Status& status) {
    if (status.ok()) WakeWatchers(id);
  });
  if (entry->jobs.empty() && entry->state == CampaignState::kRunning) BeginEvaluation(entry);
}

// mutex_ held.
void CampaignEngine::BeginEvaluation(const EntryPtr& entry) {
  ChangeState(*entry, {.change = {.state = CampaignState::kEvaluating, .message = {}, .results = {}}, .evaluated = {}},
              [](const absl::Status&) {});
  evaluations_.push_back(entry);
  to_evaluate_.notify_all();
}

// mutex_ held.
void CampaignEngine::ChangeState(Entry& entry, CampaignEnd end, CampaignStore::Done done) {
  end.change.time_us = NowUs();
  entry.state = end.change.state;
  ++entry.state_changes;
  // A campaign that is extended succeeds again, with another mean.
  if (end.gain_set) end.gain_set->id = absl::StrCat(entry.id, "-", entry.state_changes);
  const std::optional<GainSet> gain_set = end.gain_set;
  store_.EndCampaign(entry.id, ++entry.last_seq, std::move(end),
                     [this, id = entry.id, gain_set, done = std::move(done)](absl::Status status) {
                       if (status.ok()) {
                         if (gain_set && library_ != nullptr) AddToLibrary({&*gain_set, 1}, *library_);
                         WakeWatchers(id);
                       } else if (!absl::IsUnavailable(status)) {
                         Log(LogLevel::kError, "a change of state was refused",
                             {{"campaign", id}, {"error", std::string(status.message())}});
                       }
                       done(std::move(status));
                     });
}

void CampaignEngine::EvaluateLoop() {
  AddNice(kFlightNice);
  std::unique_lock lock(mutex_);
  while (true) {
    to_evaluate_.wait(lock, [this] { return stopping_ || !evaluations_.empty(); });
    if (stopping_) return;
    const EntryPtr entry = evaluations_.front();
    evaluations_.pop_front();
    lock.unlock();
    std::optional<CampaignEnd> end = Evaluate(*entry);
    lock.lock();
    if (entry->unwanted) continue;
    if (!end) {
      evaluations_.push_back(entry);
      to_evaluate_.wait_for(lock, kBeforeReadingAgain, [this] { return stopping_; });
      continue;
    }
    ChangeState(*entry, *std::move(end), [](const absl::Status&) {});
    RemoveEntry(entry->id);
  }
}

std::optional<CampaignEnd> CampaignEngine::Evaluate(const Entry& entry) {
  CampaignSpec spec;
  const auto compare = [&]() -> absl::StatusOr<CampaignOutcome> {
    const auto campaign = store_.GetCampaign(entry.id);
    if (!campaign.ok()) return campaign.status();
    auto members = AllMembers(store_, entry.id);
    if (!members.ok()) return members.status();
    std::vector<EndedMember> ended;
    for (CampaignMember& member : *members) {
      EndedMember& end = ended.emplace_back(EndedMember{.member = std::move(member)});
      if (end.member.job_id.empty()) continue;
      auto job = jobs_.GetJob(end.member.job_id);
      if (!job.ok()) return job.status();
      end.state = job->state;
      end.error_message = std::move(job->error_message);
      end.report = std::move(job->report);
    }
    spec = campaign->spec;
    return CompareGains(spec, ended, [&entry] { return entry.unwanted.load(); });
  };
  absl::StatusOr<CampaignOutcome> outcome = compare();
  if (absl::IsUnavailable(outcome.status()) || absl::IsCancelled(outcome.status())) return std::nullopt;
  CampaignEnd end;
  if (outcome.ok()) {
    end.change = {.state = CampaignState::kSucceeded, .message = {}, .results = std::move(outcome->results)};
    end.evaluated = std::move(outcome->members);
    end.gain_set = MakeMeanGainSet(entry.id, spec, *end.change.results, end.evaluated, NowUs());
  } else {
    end.change.state = CampaignState::kFailed;
    end.change.message = std::string(outcome.status().message());
  }
  return end;
}

absl::Status CampaignEngine::CheckCount(const std::string& client) {
  const std::lock_guard lock(mutex_);
  const auto is_clients = [&client](const auto& entry) { return entry.second->client == client; };
  if (std::ranges::count_if(entries_, is_clients) < max_campaigns_per_client_) return absl::OkStatus();
  return LimitExceeded("unfinished campaigns of one client", {"max-campaigns-per-client", max_campaigns_per_client_},
                       "try again when one has ended");
}

// Nothing where there are no jobs. The members' jobs are alike, but for a robust one, which is as large as they are.
absl::StatusOr<std::optional<Scheduler::Room>> CampaignEngine::ReserveFor(const std::vector<NewMember>& members) {
  const auto jobs = std::ranges::count_if(members, [](const NewMember& m) { return m.job.has_value(); });
  if (jobs == 0) return std::nullopt;
  auto room =
      scheduler_.Reserve(*std::ranges::find_if(members, [](const NewMember& m) { return m.job.has_value(); })->job,
                         static_cast<int>(jobs));
  if (!room.ok()) return room.status();
  return std::optional(*std::move(room));
}

absl::StatusOr<CampaignRecord> CampaignEngine::Create(NewCampaign campaign) {
  const std::lock_guard transition(transitions_);
  auto earlier = store_.FindRequest(campaign.request_id, campaign.request_digest);
  if (!earlier.ok()) return earlier.status();
  if (*earlier) return **std::move(earlier);
  if (absl::Status status = CheckCount(ClientOf(campaign.spec)); !status.ok()) return status;
  const auto room = ReserveFor(campaign.members);
  if (!room.ok()) return room.status();
  auto written = Await<absl::StatusOr<WrittenCampaign>>(
      [&](CampaignStore::Written done) { store_.CreateCampaign(std::move(campaign), std::move(done)); });
  if (!written.ok()) return written.status();
  Begin(*written);
  return written->record;
}

void CampaignEngine::Begin(const WrittenCampaign& written) {
  if (written.new_jobs.empty()) return;  // an earlier call began it
  {
    const std::lock_guard lock(mutex_);
    AddEntry(written.record, written.new_members);
  }
  for (const JobRecord& job : written.new_jobs) scheduler_.Add(job);
  WakeWatchers(written.record.id);
}

absl::StatusOr<CampaignRecord> CampaignEngine::Extend(const std::string& id, const std::string& etag,
                                                      const std::string& request_id, const std::string& request_digest,
                                                      const MakeExtension& make) {
  const std::lock_guard transition(transitions_);
  auto earlier = store_.FindRequest(request_id, request_digest);
  if (!earlier.ok()) return earlier.status();
  if (*earlier) return **std::move(earlier);
  const auto record = store_.GetCampaign(id);
  if (!record.ok()) return record.status();
  if (record->state != CampaignState::kSucceeded && record->state != CampaignState::kFailed) {
    return WrongCampaignState(id, record->state, "extend", "SUCCEEDED or FAILED");
  }
  if (absl::Status status = CheckCampaignEtag(id, record->state_changes, etag); !status.ok()) return status;
  auto extension = make(*record);
  if (!extension.ok()) return extension.status();
  if (absl::Status status = CheckCount(ClientOf(record->spec)); !status.ok()) return status;
  const auto room = ReserveFor(extension->members);
  if (!room.ok()) return room.status();
  extension->id = id;
  extension->seq = record->last_seq + 1;
  extension->change.time_us = NowUs();
  extension->request_id = request_id;
  extension->request_digest = request_digest;
  auto written = Await<absl::StatusOr<WrittenCampaign>>(
      [&](CampaignStore::Written done) { store_.ExtendCampaign(*std::move(extension), std::move(done)); });
  if (!written.ok()) return written.status();
  Begin(*written);
  return written->record;
}

// The jobs that wait are told first, so that none is begun in the place of one that is halted; and resumed last.
absl::StatusOr<CampaignRecord> CampaignEngine::Transition(const std::string& id, const std::string& etag,
                                                          std::string_view action, std::string_view needed,
                                                          std::initializer_list<CampaignState> allowed,
                                                          CampaignState to, JobTransition transition) {
  const std::lock_guard serial(transitions_);
  std::vector<std::pair<MemberId, std::string>> jobs;
  std::promise<absl::Status> changed;
  {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(id);
    if (found == entries_.end()) {
      const auto ended = store_.GetCampaign(id);
      return ended.ok() ? WrongCampaignState(id, ended->state, action, needed) : ended.status();
    }
    const EntryPtr entry = found->second;
    if (std::ranges::find(allowed, entry->state) == allowed.end()) {
      return WrongCampaignState(id, entry->state, action, needed);
    }
    if (absl::Status status = CheckCampaignEtag(id, entry->state_changes, etag); !status.ok()) return status;
    for (const auto& [job_id, member] : entry->jobs) jobs.emplace_back(member, job_id);
    ChangeState(*entry, {.change = {.state = to, .message = {}, .results = {}}, .evaluated = {}},
                [&changed](absl::Status status) { changed.set_value(std::move(status)); });
    if (to == CampaignState::kCancelled) RemoveEntry(id);
    if (to == CampaignState::kRunning && jobs.empty()) BeginEvaluation(entry);
  }
  if (absl::Status status = changed.get_future().get(); !status.ok()) return status;
  std::ranges::sort(jobs);
  if (to != CampaignState::kRunning) std::ranges::reverse(jobs);
  std::vector<std::string> ids;
  for (auto& [member, job_id] : jobs) ids.push_back(std::move(job_id));
  Steer(ids, transition);
  return store_.GetCampaign(id);
}

// A job that has ended meanwhile, or is where it is to go, refuses; that is as good.
void CampaignEngine::Steer(const std::vector<std::string>& jobs, JobTransition transition) {
  const auto told = std::make_shared<std::latch>(static_cast<std::ptrdiff_t>(jobs.size()));
  for (const std::string& job : jobs) {
    (scheduler_.*transition)(job, "", [told](const absl::StatusOr<JobRecord>&) { told->count_down(); });
  }
  told->wait();
}

absl::StatusOr<CampaignRecord> CampaignEngine::Pause(const std::string& id, const std::string& etag) {
  return Transition(id, etag, "pause", "RUNNING", {CampaignState::kRunning}, CampaignState::kPaused, &Scheduler::Pause);
}

absl::StatusOr<CampaignRecord> CampaignEngine::Resume(const std::string& id, const std::string& etag) {
  return Transition(id, etag, "resume", "PAUSED", {CampaignState::kPaused}, CampaignState::kRunning,
                    &Scheduler::Resume);
}

absl::StatusOr<CampaignRecord> CampaignEngine::Cancel(const std::string& id, const std::string& etag) {
  return Transition(id, etag, "cancel", "RUNNING, PAUSED or EVALUATING",
                    {CampaignState::kRunning, CampaignState::kPaused, CampaignState::kEvaluating},
                    CampaignState::kCancelled, &Scheduler::Cancel);
}

absl::Status CampaignEngine::Delete(const std::string& id, const std::string& etag) {
  const std::lock_guard transition(transitions_);
  const auto record = store_.GetCampaign(id);
  if (!record.ok()) return record.status();
  if (!IsTerminal(record->state)) {
    return WrongCampaignState(id, record->state, "delete", "SUCCEEDED, FAILED or CANCELLED (cancel it first)");
  }
  if (absl::Status status = CheckCampaignEtag(id, record->state_changes, etag); !status.ok()) return status;
  return Await<absl::Status>([&](CampaignStore::Done done) { store_.DeleteCampaign(id, std::move(done)); });
}

CampaignEngine::Subscription CampaignEngine::Subscribe(const std::string& id, Wake wake) {
  const std::lock_guard lock(watchers_mutex_);
  const std::uint64_t key = ++next_key_;
  watchers_[id].emplace(key, std::move(wake));
  return {this, id, key};
}

void CampaignEngine::WakeWatchers(const std::string& id) {
  const std::lock_guard lock(watchers_mutex_);
  const auto watchers = watchers_.find(id);
  if (watchers == watchers_.end()) return;
  for (const auto& [key, wake] : watchers->second) wake();
}

}  // namespace orbitune
