// The writes to the tables of campaigns. They run inside a transaction that the caller (SqliteWriter) begins and
// commits, beside JobTables, which has the campaigns' jobs.
#pragma once

#include <string>

#include "storage/campaign_store.h"
#include "storage/sqlite_job_tables.h"

namespace orbitune {

// A member with what is stored of it as JSON already.
struct MemberRow {
  NewMember member;
  std::optional<std::string> initial_condition_json;
  std::string job_spec_json;
  Provenance job_provenance;
};

struct CampaignDocuments {
  std::string spec_json;
  std::vector<MemberRow> members;
};

// Writer thread only. A method that refuses has written nothing. After an error of the connection the transaction must
// be rolled back.
class CampaignTables {
 public:
  // Both outlive this.
  CampaignTables(Connection& connection, JobTables& jobs) : connection_(connection), jobs_(jobs) {}

  // As CampaignStore's methods of these names.
  absl::StatusOr<WrittenCampaign> CreateCampaign(const NewCampaign& campaign, const CampaignDocuments& documents);
  absl::StatusOr<WrittenCampaign> ExtendCampaign(const CampaignExtension& extension,
                                                 const CampaignDocuments& documents);
  absl::Status AppendMemberEnded(const std::string& id, std::int64_t seq, const MemberEnded& ended);
  absl::Status ChangeState(const std::string& id, std::int64_t seq, const CampaignStateChange& change,
                           const std::optional<std::string>& results_json);
  absl::Status AddGainSet(const GainSet& set) { return jobs_.AddGainSets({set}); }
  absl::Status WriteEpisodes(const std::string& id, MemberId member, const std::string& episodes_json);
  absl::Status DeleteCampaign(const std::string& id);

 private:
  absl::Status CheckNextSeq(const std::string& id, std::int64_t seq);
  absl::Status InsertRequest(const std::string& request_id, const std::string& request_digest, const std::string& id);
  absl::Status InsertCampaign(const NewCampaign& campaign, const std::string& spec_json);
  absl::Status InsertMembers(const std::string& id, TimeUs time_us, const std::vector<MemberRow>& members,
                             WrittenCampaign& written);
  absl::Status InsertStateChange(const std::string& id, std::int64_t seq, const CampaignStateChange& change);
  template <typename Write>
  absl::StatusOr<WrittenCampaign> AllOrNothing(const std::string& id, const Write& write);

  Connection& connection_;
  JobTables& jobs_;
};

}  // namespace orbitune
