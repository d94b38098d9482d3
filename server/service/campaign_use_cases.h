// The use cases of campaigns, in domain types, once for every transport. Validation lives here.
#pragma once

#include "server/jobs/campaign_engine.h"
#include "server/service/use_cases.h"

namespace orbitune {

// Initial conditions as a user gives them: listed or drawn.
struct InitialConditionSource {
  struct Draw {
    IcDistribution distribution;        // std::monostate: whatever goes without saying
    std::optional<std::uint64_t> seed;  // likewise
    int count = 0;
  };
  std::vector<OrbitState> list;
  std::optional<Draw> draw;
};

struct CampaignRequest {
  struct Robust {
    SearchOverrides search;
    std::optional<Objective> objective;  // the mean of J / J(K(1))
  };
  NewJob job;  // what every initial condition's has in common; without one
  InitialConditionSource initial_conditions;
  InitialConditionSource held_out;
  bool tune_held_out = false;
  std::optional<Robust> robust;
};

// A member with what its job is at. Its episodes are those that are known.
struct MemberView {
  CampaignMember member;
  std::optional<JobRecord> job;
  double sampling_period_s = 0;
};

// A member's job has ended (then with the member), or the campaign's state has changed.
struct CampaignEventView {
  CampaignEvent event;
  std::optional<MemberView> member;
};

// Thread-safe. Calls that write wait until what they say is on disk; none must be made where blocking is not allowed.
// Creations ask `cancelled` now and then; once true, nothing is stored, and the answer is CANCELLED.
// All errors: INVALID_ARGUMENT with field violations, NOT_FOUND, and what the store and the engine say.
class CampaignUseCases {
 public:
  static constexpr int kMostInitialConditions = 10'000;

  // All outlive this.
  CampaignUseCases(UseCases& use_cases, CampaignStore& store, CampaignEngine& engine)
      : use_cases_(use_cases), store_(store), engine_(engine) {}

  absl::StatusOr<CampaignRecord> Create(const CampaignRequest& request, const std::string& request_id,
                                        bool validate_only, const std::function<bool()>& cancelled = {});
  absl::StatusOr<CampaignRecord> Get(const std::string& id);
  absl::StatusOr<Page<CampaignRecord>> List(int page_size, const std::string& page_token,
                                            const std::vector<CampaignState>& states);
  absl::StatusOr<CampaignRecord> Pause(const std::string& id, const std::string& etag);
  absl::StatusOr<CampaignRecord> Resume(const std::string& id, const std::string& etag);
  absl::StatusOr<CampaignRecord> Cancel(const std::string& id, const std::string& etag);
  absl::Status Delete(const std::string& id, const std::string& etag);
  absl::StatusOr<CampaignRecord> Extend(const std::string& id, const InitialConditionSource& more,
                                        const std::string& request_id, const std::string& etag,
                                        const std::function<bool()>& cancelled = {});
  absl::StatusOr<Page<MemberView>> ListMembers(const std::string& id, int page_size, const std::string& page_token);

  // Events after `after_seq`, at most `limit`.
  absl::StatusOr<std::vector<CampaignEventView>> ListEvents(const std::string& id, std::int64_t after_seq, int limit);

  // For watchers.
  CampaignEngine& engine() { return engine_; }

 private:
  struct Resolved;
  absl::StatusOr<Resolved> Resolve(const CampaignRequest& request, const std::function<bool()>& cancelled) const;
  absl::StatusOr<RobustTuning> ResolveRobust(const CampaignRequest& request,
                                             const std::vector<OrbitState>& tuned) const;
  static std::vector<NewMember> MakeMembers(const std::string& id, const CampaignSpec& spec, MemberRole role, int first,
                                            const std::vector<OrbitState>& states);
  static NewMember MakeRobustMember(const std::string& id, const CampaignSpec& spec, int number,
                                    const std::vector<OrbitState>& tuned);
  static absl::StatusOr<std::vector<OrbitState>> MoreStates(CampaignSpec& spec, const InitialConditionSource& more);
  absl::StatusOr<CampaignExtension> MakeExtension(const CampaignRecord& record, const InitialConditionSource& more,
                                                  const std::function<bool()>& cancelled);
  absl::StatusOr<std::vector<OrbitState>> TunedStates(const std::string& id);
  absl::StatusOr<MemberView> View(const CampaignSpec& spec, CampaignMember member);

  UseCases& use_cases_;
  CampaignStore& store_;
  CampaignEngine& engine_;
};

}  // namespace orbitune
