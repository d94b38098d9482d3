#include "storage/sqlite_campaign_tables.h"

#include "absl/strings/str_cat.h"
#include "storage/serialise.h"
#include "storage/sqlite_campaign_queries.h"

namespace orbitune {
namespace {

std::optional<TimeUs> TimeIf(bool condition, TimeUs time_us) {
  return condition ? std::optional(time_us) : std::nullopt;
}

}  // namespace

absl::Status CampaignTables::CheckNextSeq(const std::string& id, std::int64_t seq) {
  auto statement = connection_.Prepare("SELECT last_seq FROM campaigns WHERE id = ?");
  if (!statement.ok()) return statement.status();
  const absl::StatusOr<bool> row = statement->Bind(id).Step();
  if (!row.ok()) return row.status();
  if (!*row) return CampaignNotFound(id);
  if (seq == statement->Int(0) + 1) return absl::OkStatus();
  return absl::InternalError(
      absl::StrCat("campaign ", id, ": event ", seq, " cannot follow event ", statement->Int(0)));
}

absl::Status CampaignTables::InsertRequest(const std::string& request_id, const std::string& request_digest,
                                           const std::string& id) {
  if (request_id.empty()) return absl::OkStatus();
  return connection_.Run("INSERT INTO campaign_requests (request_id, digest, campaign) VALUES (?, ?, ?)", request_id,
                         request_digest, id);
}

// Runs `write`, which fills in the new jobs; what it wrote is taken back if it fails.
template <typename Write>
absl::StatusOr<WrittenCampaign> CampaignTables::AllOrNothing(const std::string& id, const Write& write) {
  if (absl::Status status = connection_.Run("SAVEPOINT campaign"); !status.ok()) return status;
  WrittenCampaign written;
  absl::Status status = write(written);
  if (!status.ok()) (void)connection_.Run("ROLLBACK TO campaign");
  const absl::Status released = connection_.Run("RELEASE campaign");
  if (status.ok()) status = released;
  if (!status.ok()) return status;
  absl::StatusOr<CampaignRecord> record = ReadCampaign(connection_, id);
  if (!record.ok()) return record.status();
  written.record = *std::move(record);
  return written;
}

absl::StatusOr<WrittenCampaign> CampaignTables::CreateCampaign(const NewCampaign& campaign,
                                                               const CampaignDocuments& documents) {
  if (absl::Status status = jobs_.WriteProgress(); !status.ok()) return status;
  auto earlier = ReadRequest(connection_, campaign.request_id, campaign.request_digest);
  if (!earlier.ok()) return earlier.status();
  if (*earlier) return WrittenCampaign{.record = **std::move(earlier)};
  return AllOrNothing(campaign.id, [&](WrittenCampaign& written) {
    absl::Status status = InsertCampaign(campaign, documents.spec_json);
    if (status.ok()) status = InsertRequest(campaign.request_id, campaign.request_digest, campaign.id);
    if (status.ok()) status = InsertMembers(campaign.id, campaign.time_us, documents.members, written);
    return status;
  });
}

absl::Status CampaignTables::InsertCampaign(const NewCampaign& campaign, const std::string& spec_json) {
  absl::Status status = connection_.Run(
      "INSERT INTO campaigns (id, state, scenario_id, create_time_us, update_time_us, last_seq, state_changes, spec, "
      "error_message) VALUES (?, ?, ?, ?, ?, 1, 1, ?, '')",
      campaign.id, NameOf(CampaignState::kRunning), campaign.spec.scenario.id, campaign.time_us, campaign.time_us,
      spec_json);
  if (!status.ok()) return status;
  return InsertStateChange(campaign.id, 1, {.time_us = campaign.time_us, .message = {}, .results = {}});
}

absl::Status CampaignTables::InsertMembers(const std::string& id, TimeUs time_us, const std::vector<MemberRow>& members,
                                           WrittenCampaign& written) {
  for (const MemberRow& row : members) {
    const CampaignMember& member = row.member.member;
    std::optional<std::string> job_id;
    if (row.member.job) {
      job_id = member.job_id;
      auto job = jobs_.CreateJob({.id = member.job_id,
                                  .spec = *row.member.job,
                                  .spec_json = row.job_spec_json,
                                  .provenance = row.job_provenance,
                                  .time_us = time_us,
                                  .request_id = {},
                                  .request_digest = {}});
      if (!job.ok()) return job.status();
      written.new_jobs.push_back(*std::move(job));
      written.new_members.emplace_back(member.job_id, member.id);
    }
    absl::Status status = connection_.Run(
        "INSERT INTO campaign_members (campaign, role, number, initial_condition, job) "
        "VALUES (?, ?, ?, ?, (SELECT key FROM jobs WHERE id = ?))",
        id, static_cast<int>(member.id.role), member.id.number, row.initial_condition_json, job_id);
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::StatusOr<WrittenCampaign> CampaignTables::ExtendCampaign(const CampaignExtension& extension,
                                                               const CampaignDocuments& documents) {
  auto earlier = ReadRequest(connection_, extension.request_id, extension.request_digest);
  if (!earlier.ok()) return earlier.status();
  if (*earlier) return WrittenCampaign{.record = **std::move(earlier)};
  if (absl::Status status = CheckNextSeq(extension.id, extension.seq); !status.ok()) return status;
  return AllOrNothing(extension.id, [&](WrittenCampaign& written) {
    absl::Status status = InsertRequest(extension.request_id, extension.request_digest, extension.id);
    if (status.ok()) status = ChangeState(extension.id, extension.seq, extension.change, std::nullopt);
    if (status.ok()) {
      status = connection_.Run("UPDATE campaigns SET spec = ? WHERE id = ?", documents.spec_json, extension.id);
    }
    if (status.ok()) {
      status = connection_.Run("UPDATE campaign_members SET episodes = NULL WHERE campaign = ?", extension.id);
    }
    if (status.ok()) status = InsertMembers(extension.id, extension.change.time_us, documents.members, written);
    return status;
  });
}

absl::Status CampaignTables::AppendMemberEnded(const std::string& id, std::int64_t seq, const MemberEnded& ended) {
  if (absl::Status status = CheckNextSeq(id, seq); !status.ok()) return status;
  absl::Status status = connection_.Run(
      "INSERT INTO campaign_events (campaign, seq, time_us, role, number, job, state, message) "
      "VALUES (?, ?, ?, ?, ?, ?, ?, '')",
      id, seq, ended.time_us, static_cast<int>(ended.member.role), ended.member.number, ended.job_id,
      NameOf(ended.state));
  if (!status.ok()) return status;
  return connection_.Run("UPDATE campaigns SET last_seq = ? WHERE id = ?", seq, id);
}

absl::Status CampaignTables::InsertStateChange(const std::string& id, std::int64_t seq,
                                               const CampaignStateChange& change) {
  return connection_.Run("INSERT INTO campaign_events (campaign, seq, time_us, state, message) VALUES (?, ?, ?, ?, ?)",
                         id, seq, change.time_us, NameOf(change.state), change.message);
}

absl::Status CampaignTables::ChangeState(const std::string& id, std::int64_t seq, const CampaignStateChange& change,
                                         const std::optional<std::string>& results_json) {
  if (absl::Status status = CheckNextSeq(id, seq); !status.ok()) return status;
  if (absl::Status status = InsertStateChange(id, seq, change); !status.ok()) return status;
  const bool failed = change.state == CampaignState::kFailed;
  return connection_.Run(
      "UPDATE campaigns SET state = ?, update_time_us = ?, end_time_us = ?, error_message = ?, results = ?, "
      "last_seq = ?, state_changes = state_changes + 1 WHERE id = ?",
      NameOf(change.state), change.time_us, TimeIf(IsTerminal(change.state), change.time_us),
      failed ? std::string_view(change.message) : std::string_view(), results_json, seq, id);
}

absl::Status CampaignTables::WriteEpisodes(const std::string& id, MemberId member, const std::string& episodes_json) {
  return connection_.Run("UPDATE campaign_members SET episodes = ? WHERE campaign = ? AND role = ? AND number = ?",
                         episodes_json, id, static_cast<int>(member.role), member.number);
}

absl::Status CampaignTables::DeleteCampaign(const std::string& id) {
  const absl::StatusOr<CampaignRecord> campaign = ReadCampaign(connection_, id);
  if (!campaign.ok()) return campaign.status();
  for (const MemberCounts& counts : campaign->counts) {
    if (counts.jobs == counts.ended) continue;
    return WithReason(
        absl::FailedPreconditionError(absl::StrCat("campaigns/", id, ": ", counts.jobs - counts.ended,
                                                   " of its jobs have not "
                                                   "ended; to delete it, they must have (cancel it first)")),
        "CAMPAIGN_STATE");
  }
  const absl::StatusOr<std::vector<std::string>> jobs = ReadJobIdsOf(connection_, id);
  if (!jobs.ok()) return jobs.status();
  // Members, events and requests go with it.
  absl::Status status = connection_.Run("DELETE FROM campaigns WHERE id = ?", id);
  for (const std::string& job : *jobs) {
    if (!status.ok()) return status;
    status = jobs_.DeleteJob(job);
  }
  return status;
}

}  // namespace orbitune
