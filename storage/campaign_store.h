// Where campaigns are kept: in the same place, by the same writer and under the same rules as their jobs
// (storage/job_store.h), so that a campaign and its members come and go in one commit.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "storage/campaign.h"

namespace orbitune {

// A member to be created, with its job if it gets one. The job's spec names the campaign.
struct NewMember {
  CampaignMember member;
  std::optional<JobSpec> job;  // where member.job_id is not empty
};

struct NewCampaign {
  std::string id;  // unused so far
  CampaignSpec spec;
  std::vector<NewMember> members;
  TimeUs time_us = 0;
  std::string request_id;      // empty: none given
  std::string request_digest;  // of what was asked for
};

struct CampaignExtension {
  std::string id;
  std::int64_t seq = 0;  // the campaign's last one + 1
  CampaignSpec spec;     // as it is from now on
  std::vector<NewMember> members;
  CampaignStateChange change;  // to kRunning
  std::string request_id;
  std::string request_digest;
};

// What was written, or, for a request id that was seen before, what an earlier call with it wrote.
struct WrittenCampaign {
  CampaignRecord record;
  // In the order of the members; empty: an earlier call created them.
  std::vector<JobRecord> new_jobs;
  std::vector<std::pair<std::string, MemberId>> new_members;  // by their jobs' ids
};

struct CampaignEnd {
  CampaignStateChange change;
  std::vector<CampaignMember> evaluated;  // members with their episodes
  std::optional<GainSet> gain_set;        // the mean of the tuned gains, where kSucceeded
};

struct CampaignQuery {
  std::vector<CampaignState> states;  // any of; empty: every one
  int limit = 50;                     // > 0
  struct Cursor {
    TimeUs create_time_us = 0;
    std::string id;
  };
  std::optional<Cursor> after;
};

// Thread-safe; callbacks, waits and errors as JobStore's.
class CampaignStore {
 public:
  using Done = std::function<void(absl::Status)>;
  using Written = std::function<void(absl::StatusOr<WrittenCampaign>)>;

  CampaignStore() = default;
  CampaignStore(const CampaignStore&) = delete;
  CampaignStore& operator=(const CampaignStore&) = delete;
  virtual ~CampaignStore() = default;

  // Stores the campaign in kRunning, with event 1, and all its members and their jobs, or nothing. A request_id seen
  // before: as JobStore::CreateJob's, among campaigns and extensions.
  virtual void CreateCampaign(NewCampaign campaign, Written done) = 0;

  // Adds members to a campaign that has ended; its results so far go. A request_id seen before: likewise.
  virtual void ExtendCampaign(CampaignExtension extension, Written done) = 0;

  // seq: the campaign's last one + 1.
  virtual void AppendMemberEnded(const std::string& id, std::int64_t seq, const MemberEnded& ended, Done done) = 0;
  virtual void ChangeState(const std::string& id, std::int64_t seq, CampaignStateChange change, Done done) = 0;
  // A change of state with what the members came to.
  virtual void EndCampaign(const std::string& id, std::int64_t seq, CampaignEnd end, Done done) = 0;

  // Removes the campaign, its members and their jobs. FAILED_PRECONDITION (reason CAMPAIGN_STATE), and nothing is
  // removed, where one of the jobs has not ended.
  virtual void DeleteCampaign(const std::string& id, Done done) = 0;

  // The campaign that an earlier call with this request id wrote to; none: it is free (an empty one always). Errors as
  // CreateCampaign's for another digest.
  virtual absl::StatusOr<std::optional<CampaignRecord>> FindRequest(const std::string& request_id,
                                                                    const std::string& request_digest) const = 0;

  // NOT_FOUND if there is none.
  virtual absl::StatusOr<CampaignRecord> GetCampaign(const std::string& id) const = 0;

  // The newest first; without results.
  virtual absl::StatusOr<std::vector<CampaignRecord>> ListCampaigns(const CampaignQuery& query) const = 0;

  // In kRunning, kPaused or kEvaluating, the oldest first; without results.
  virtual absl::StatusOr<std::vector<CampaignRecord>> ListUnfinishedCampaigns() const = 0;

  // Members behind `after`, in order, at most `limit`. NOT_FOUND for an unknown campaign.
  virtual absl::StatusOr<std::vector<CampaignMember>> ListMembers(const std::string& id, MemberId after,
                                                                  int limit) const = 0;

  // Events after `after_seq`, ascending and dense, at most `limit`. NOT_FOUND for an unknown campaign.
  virtual absl::StatusOr<std::vector<CampaignEvent>> ListCampaignEvents(const std::string& id, std::int64_t after_seq,
                                                                        int limit) const = 0;
};

}  // namespace orbitune
