// Runs campaigns: begins, halts and ends their jobs together, records which have ended, and compares the gains once all
// have. The jobs themselves are the scheduler's like any other.
//
// What is wanted of a campaign is on disk before its jobs are told, so that after a crash Start can tell them again.
#pragma once

#include <condition_variable>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "server/jobs/scheduler.h"
#include "storage/campaign_store.h"

namespace orbitune {

// A campaign's version for optimistic locking: changes with each state change.
std::string EtagOf(const CampaignRecord& record);

// Thread-safe. Calls that change something wait until it is on disk, and the jobs have been told.
class CampaignEngine {
 public:
  // Called after a change, on whatever thread made it; must not block nor call back.
  using Wake = std::function<void()>;

  // Ends with the object: after its destruction the wake function is not called any more, nor running.
  class Subscription {
   public:
    Subscription() = default;
    Subscription(CampaignEngine* engine, std::string id, std::uint64_t key)
        : engine_(engine), id_(std::move(id)), key_(key) {}
    Subscription(Subscription&& other) noexcept { *this = std::move(other); }
    Subscription& operator=(Subscription&& other) noexcept;
    ~Subscription();

   private:
    CampaignEngine* engine_ = nullptr;
    std::string id_;
    std::uint64_t key_ = 0;
  };

  // All outlive this; jobs must not be running yet. store: of the campaigns, in `jobs`' place.
  // library: is told of every mean of gains, once it is stored; nullptr: none. max_campaigns_per_client: unfinished.
  CampaignEngine(JobStore& jobs, CampaignStore& store, Scheduler& scheduler, EventHub& hub,
                 GainLibrary* library = nullptr, int max_campaigns_per_client = 100);
  CampaignEngine(const CampaignEngine&) = delete;
  CampaignEngine& operator=(const CampaignEngine&) = delete;
  ~CampaignEngine();  // stops; the scheduler must have stopped before

  // Takes up every unfinished campaign; to be called when the scheduler has started. Errors: the stores'.
  absl::Status Start();

  // Ends comparisons under way, to be made again by the next Start of a process. Before the scheduler's.
  void Stop();

  // The campaign created, or the one that an earlier call with the same request id created. Errors: the store's;
  // RESOURCE_EXHAUSTED where the client has too many campaigns, or there is no room for the jobs.
  absl::StatusOr<CampaignRecord> Create(NewCampaign campaign);

  // What is to be added to a campaign, given as it is: its spec from now on, members, and the change's message.
  using MakeExtension = std::function<absl::StatusOr<CampaignExtension>(const CampaignRecord&)>;
  // FAILED_PRECONDITION unless it has SUCCEEDED or FAILED; ABORTED for another etag. A request id seen before: as
  // Create's.
  absl::StatusOr<CampaignRecord> Extend(const std::string& id, const std::string& etag, const std::string& request_id,
                                        const std::string& request_digest, const MakeExtension& make);

  // etag: empty, or the campaign's (else ABORTED). NOT_FOUND; FAILED_PRECONDITION where the state does not allow it.
  absl::StatusOr<CampaignRecord> Pause(const std::string& id, const std::string& etag);
  absl::StatusOr<CampaignRecord> Resume(const std::string& id, const std::string& etag);
  absl::StatusOr<CampaignRecord> Cancel(const std::string& id, const std::string& etag);
  absl::Status Delete(const std::string& id, const std::string& etag);

  // wake: after every event of the campaign and, some times a second at most, as its jobs get on.
  Subscription Subscribe(const std::string& id, Wake wake);

 private:
  struct Entry;
  using EntryPtr = std::shared_ptr<Entry>;
  using JobTransition = void (Scheduler::*)(const std::string&, const std::string&, Scheduler::Done);

  absl::Status CheckCount(const std::string& client);
  absl::StatusOr<std::optional<Scheduler::Room>> ReserveFor(const std::vector<NewMember>& members);
  absl::Status TakeUp(const CampaignRecord& record, const std::map<std::string, JobRecord>& unfinished);
  void TellJobs(const std::vector<JobRecord>& unfinished);
  void AddEntry(const CampaignRecord& record, const std::vector<std::pair<std::string, MemberId>>& jobs);
  void Begin(const WrittenCampaign& written);
  void OnJobEvent(const std::string& job_id, const JobEvent& event);
  void JobEnded(const EntryPtr& entry, const std::string& job_id, JobState state, TimeUs time_us);
  void ChangeState(Entry& entry, CampaignEnd end, CampaignStore::Done done);
  void BeginEvaluation(const EntryPtr& entry);
  void EvaluateLoop();
  // Nothing where the store cannot be read at the moment, or nobody wants it any more.
  std::optional<CampaignEnd> Evaluate(const Entry& entry);
  void RemoveEntry(const std::string& id);
  absl::StatusOr<CampaignRecord> Transition(const std::string& id, const std::string& etag, std::string_view action,
                                            std::string_view needed, std::initializer_list<CampaignState> allowed,
                                            CampaignState to, JobTransition transition);
  void Steer(const std::vector<std::string>& jobs, JobTransition transition);
  void WakeWatchers(const std::string& id);

  JobStore& jobs_;
  CampaignStore& store_;
  Scheduler& scheduler_;
  EventHub& hub_;
  GainLibrary* const library_;
  const int max_campaigns_per_client_;

  std::mutex transitions_;  // held through a call that changes something; before mutex_

  std::mutex mutex_;
  std::condition_variable to_evaluate_;
  // Guarded by mutex_.
  std::map<std::string, EntryPtr> entries_;              // of the unfinished campaigns
  std::map<std::string, EntryPtr, std::less<>> by_job_;  // of their jobs that have not ended
  std::deque<EntryPtr> evaluations_;
  bool stopping_ = false;

  std::mutex watchers_mutex_;  // after mutex_
  // Guarded by watchers_mutex_.
  std::map<std::string, std::map<std::uint64_t, Wake>> watchers_;
  std::uint64_t next_key_ = 0;

  std::thread evaluator_;
};

}  // namespace orbitune
