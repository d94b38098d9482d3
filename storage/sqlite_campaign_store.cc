#include "storage/sqlite_campaign_store.h"

#include <utility>

#include "storage/serialise.h"
#include "storage/sqlite_campaign_queries.h"
#include "storage/sqlite_campaign_tables.h"
#include "storage/sqlite_provenance.h"

namespace orbitune {
namespace {

absl::StatusOr<CampaignDocuments> DocumentsOf(const CampaignSpec& spec, std::vector<NewMember> members) {
  CampaignDocuments documents;
  absl::StatusOr<std::string> spec_json = ToJson(spec);
  if (!spec_json.ok()) return spec_json.status();
  documents.spec_json = *std::move(spec_json);
  documents.members.reserve(members.size());
  for (NewMember& member : members) {
    MemberRow row;
    if (member.job) {
      absl::StatusOr<std::string> job_spec = ToJson(*member.job);
      if (!job_spec.ok()) return job_spec.status();
      row.job_spec_json = *std::move(job_spec);
      row.job_provenance = NewProvenance(*member.job);
    }
    const OrbitState& state = member.member.initial_condition;
    if (!std::holds_alternative<std::monostate>(state)) row.initial_condition_json = ToJson(state);
    row.member = std::move(member);
    documents.members.push_back(std::move(row));
  }
  return documents;
}

}  // namespace

template <typename Apply>
void SqliteCampaignStore::Queue(Apply apply, Done done, bool refusable) {
  const auto run = [this, apply = std::move(apply)](JobTables& jobs) {
    CampaignTables tables(writing_, jobs);
    return apply(tables);
  };
  writer_.Queue({.apply = run, .answer = std::move(done), .refusable = refusable});
}

template <typename Apply>
void SqliteCampaignStore::QueueWritten(Apply apply, Written done) {
  auto written = std::make_shared<WrittenCampaign>();
  const auto run = [written, apply = std::move(apply)](CampaignTables& tables) {
    absl::StatusOr<WrittenCampaign> result = apply(tables);
    if (result.ok()) *written = *std::move(result);
    return result.status();
  };
  const auto answer = [written, done = std::move(done)](absl::Status status) {
    status.ok() ? done(std::move(*written)) : done(std::move(status));
  };
  Queue(run, answer, /*refusable=*/true);
}

// In its turn, with a status of the writer's own.
void SqliteCampaignStore::Refuse(const absl::Status& fault, Written done) {
  QueueWritten([text = std::string(fault.message())](
                   CampaignTables&) -> absl::StatusOr<WrittenCampaign> { return absl::InvalidArgumentError(text); },
               std::move(done));
}

void SqliteCampaignStore::CreateCampaign(NewCampaign campaign, Written done) {
  auto documents = DocumentsOf(campaign.spec, std::move(campaign.members));
  if (!documents.ok()) return Refuse(documents.status(), std::move(done));
  const auto shared =
      std::make_shared<const std::pair<NewCampaign, CampaignDocuments>>(std::move(campaign), *std::move(documents));
  QueueWritten([shared](CampaignTables& tables) { return tables.CreateCampaign(shared->first, shared->second); },
               std::move(done));
}

void SqliteCampaignStore::ExtendCampaign(CampaignExtension extension, Written done) {
  auto documents = DocumentsOf(extension.spec, std::move(extension.members));
  if (!documents.ok()) return Refuse(documents.status(), std::move(done));
  const auto shared = std::make_shared<const std::pair<CampaignExtension, CampaignDocuments>>(std::move(extension),
                                                                                              *std::move(documents));
  QueueWritten([shared](CampaignTables& tables) { return tables.ExtendCampaign(shared->first, shared->second); },
               std::move(done));
}

void SqliteCampaignStore::AppendMemberEnded(const std::string& id, std::int64_t seq, const MemberEnded& ended,
                                            Done done) {
  Queue([id, seq, ended](CampaignTables& tables) { return tables.AppendMemberEnded(id, seq, ended); }, std::move(done));
}

void SqliteCampaignStore::ChangeState(const std::string& id, std::int64_t seq, CampaignStateChange change, Done done) {
  EndCampaign(id, seq, {.change = std::move(change), .evaluated = {}}, std::move(done));
}

void SqliteCampaignStore::EndCampaign(const std::string& id, std::int64_t seq, CampaignEnd end, Done done) {
  const auto results_json = end.change.results ? std::optional(ToJson(*end.change.results)) : std::nullopt;
  std::vector<std::pair<MemberId, std::string>> episodes;
  for (const CampaignMember& member : end.evaluated) episodes.emplace_back(member.id, ToJson(member.episodes));
  Queue(
      [id, seq, change = std::move(end.change), results_json, episodes = std::move(episodes),
       gain_set = std::move(end.gain_set)](CampaignTables& tables) {
        absl::Status status = tables.ChangeState(id, seq, change, results_json);
        if (status.ok() && gain_set) status = tables.AddGainSet(*gain_set);
        for (const auto& [member, json] : episodes) {
          if (!status.ok()) return status;
          status = tables.WriteEpisodes(id, member, json);
        }
        return status;
      },
      std::move(done));
}

void SqliteCampaignStore::DeleteCampaign(const std::string& id, Done done) {
  Queue([id](CampaignTables& tables) { return tables.DeleteCampaign(id); }, std::move(done), /*refusable=*/true);
}

absl::StatusOr<std::optional<CampaignRecord>> SqliteCampaignStore::FindRequest(
    const std::string& request_id, const std::string& request_digest) const {
  return readers_.Run([&](Connection& connection) { return ReadRequest(connection, request_id, request_digest); });
}

absl::StatusOr<CampaignRecord> SqliteCampaignStore::GetCampaign(const std::string& id) const {
  return readers_.Run([&](Connection& connection) { return ReadCampaign(connection, id); });
}

absl::StatusOr<std::vector<CampaignRecord>> SqliteCampaignStore::ListCampaigns(const CampaignQuery& query) const {
  return readers_.Run([&](Connection& connection) { return ReadCampaigns(connection, query); });
}

absl::StatusOr<std::vector<CampaignRecord>> SqliteCampaignStore::ListUnfinishedCampaigns() const {
  return readers_.Run([](Connection& connection) { return ReadUnfinishedCampaigns(connection); });
}

absl::StatusOr<std::vector<CampaignMember>> SqliteCampaignStore::ListMembers(const std::string& id, MemberId after,
                                                                             int limit) const {
  return readers_.Run([&](Connection& connection) { return ReadMembersOf(connection, id, after, limit); });
}

absl::StatusOr<std::vector<CampaignEvent>> SqliteCampaignStore::ListCampaignEvents(const std::string& id,
                                                                                   std::int64_t after_seq,
                                                                                   int limit) const {
  return readers_.Run([&](Connection& connection) { return ReadCampaignEventsOf(connection, id, after_seq, limit); });
}

}  // namespace orbitune
