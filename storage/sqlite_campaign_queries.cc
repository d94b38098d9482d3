#include "storage/sqlite_campaign_queries.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "storage/serialise.h"

namespace orbitune {
namespace {

std::string SelectCampaigns(std::string_view results, std::string_view tail) {
  return absl::StrCat(
      "SELECT id, state, create_time_us, end_time_us, update_time_us, last_seq, state_changes, spec, error_message, ",
      ToAbsl(results), " FROM campaigns", ToAbsl(tail));
}

absl::Status InCampaign(const std::string& id, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat("campaign ", id, ": ", status.message()));
}

absl::StatusOr<MemberRole> RoleOf(std::int64_t number) {
  if (number >= 0 && number < static_cast<std::int64_t>(kMemberRoles)) return static_cast<MemberRole>(number);
  return absl::DataLossError(absl::StrCat("a member has the unknown role ", number));
}

absl::StatusOr<CampaignRecord> CampaignIn(const Statement& row) {
  CampaignRecord record;
  record.id = row.Text(0);
  const absl::StatusOr<CampaignState> state = CampaignStateOf(row.Text(1));
  if (!state.ok()) return InCampaign(record.id, state.status());
  record.state = *state;
  record.create_time_us = row.Int(2);
  record.end_time_us = row.Int(3);
  record.update_time_us = row.Int(4);
  record.last_seq = row.Int(5);
  record.state_changes = row.Int(6);
  absl::StatusOr<CampaignSpec> spec = CampaignSpecFromJson(row.Text(7));
  if (!spec.ok()) return InCampaign(record.id, spec.status());
  record.spec = *std::move(spec);
  record.error_message = row.Text(8);
  if (row.IsNull(9)) return record;
  absl::StatusOr<CampaignResults> results = CampaignResultsFromJson(row.Text(9));
  if (!results.ok()) return InCampaign(record.id, results.status());
  record.results = *std::move(results);
  return record;
}

absl::Status CountMembers(Connection& connection, CampaignRecord& record) {
  auto statement = connection.Prepare(
      "SELECT role, count(*), count(job), sum(state IN ('SUCCEEDED', 'FAILED', 'CANCELLED')), "
      "sum(state = 'SUCCEEDED'), sum(state = 'RUNNING'), sum(iterations) "
      "FROM campaign_members LEFT JOIN jobs ON jobs.key = job WHERE campaign_members.campaign = ? GROUP BY role");
  if (!statement.ok()) return statement.status();
  return statement->Bind(record.id).ForEachRow([&] {
    const absl::StatusOr<MemberRole> role = RoleOf(statement->Int(0));
    if (!role.ok()) return InCampaign(record.id, role.status());
    record.counts[static_cast<std::size_t>(*role)] = {.members = static_cast<int>(statement->Int(1)),
                                                      .jobs = static_cast<int>(statement->Int(2)),
                                                      .ended = static_cast<int>(statement->Int(3)),
                                                      .succeeded = static_cast<int>(statement->Int(4)),
                                                      .running = static_cast<int>(statement->Int(5)),
                                                      .iterations = statement->Int(6)};
    return absl::OkStatus();
  });
}

absl::StatusOr<std::vector<CampaignRecord>> ReadRecords(Connection& connection, Statement& statement) {
  std::vector<CampaignRecord> records;
  absl::Status status = statement.ForEachRow([&] {
    absl::StatusOr<CampaignRecord> record = CampaignIn(statement);
    if (record.ok()) records.push_back(*std::move(record));
    return record.status();
  });
  for (CampaignRecord& record : records) {
    if (status.ok()) status = CountMembers(connection, record);
  }
  if (!status.ok()) return status;
  return records;
}

absl::StatusOr<CampaignMember> MemberIn(const Statement& row) {
  CampaignMember member;
  const absl::StatusOr<MemberRole> role = RoleOf(row.Int(0));
  if (!role.ok()) return role.status();
  member.id = {.role = *role, .number = static_cast<int>(row.Int(1))};
  member.job_id = row.Text(3);
  if (!row.IsNull(2)) {
    absl::StatusOr<OrbitState> state = OrbitStateFromJson(row.Text(2));
    if (!state.ok()) return state.status();
    member.initial_condition = *std::move(state);
  }
  if (row.IsNull(4)) return member;
  absl::StatusOr<std::vector<MemberEpisode>> episodes = MemberEpisodesFromJson(row.Text(4));
  if (!episodes.ok()) return episodes.status();
  member.episodes = *std::move(episodes);
  return member;
}

absl::StatusOr<CampaignEvent> EventIn(const Statement& row) {
  if (row.IsNull(3)) {
    CampaignStateChange change{.time_us = row.Int(1), .message = row.Text(6), .results = {}};
    const absl::StatusOr<CampaignState> state = CampaignStateOf(row.Text(2));
    if (!state.ok()) return state.status();
    change.state = *state;
    return CampaignEvent{.seq = row.Int(0), .what = std::move(change)};
  }
  const absl::StatusOr<MemberRole> role = RoleOf(row.Int(3));
  if (!role.ok()) return role.status();
  const absl::StatusOr<JobState> state = JobStateOf(row.Text(2));
  if (!state.ok()) return state.status();
  return CampaignEvent{.seq = row.Int(0),
                       .what = MemberEnded{.member = {.role = *role, .number = static_cast<int>(row.Int(4))},
                                           .job_id = row.Text(5),
                                           .state = *state,
                                           .time_us = row.Int(1)}};
}

// NOT_FOUND where there is no such campaign.
absl::StatusOr<std::int64_t> ReadLastSeq(Connection& connection, const std::string& id) {
  auto statement = connection.Prepare("SELECT last_seq FROM campaigns WHERE id = ?");
  if (!statement.ok()) return statement.status();
  const absl::StatusOr<bool> row = statement->Bind(id).Step();
  if (!row.ok()) return row.status();
  if (!*row) return CampaignNotFound(id);
  return statement->Int(0);
}

}  // namespace

absl::Status CampaignNotFound(const std::string& id) {
  return absl::NotFoundError(absl::StrCat("there is no campaign ", FormatReceived(id)));
}

absl::StatusOr<CampaignRecord> ReadCampaign(Connection& connection, const std::string& id) {
  auto statement = connection.Prepare(SelectCampaigns("results", " WHERE id = ?"));
  if (!statement.ok()) return statement.status();
  auto records = ReadRecords(connection, statement->Bind(id));
  if (!records.ok()) return records.status();
  if (records->empty()) return CampaignNotFound(id);
  return std::move(records->front());
}

absl::StatusOr<std::optional<CampaignRecord>> ReadRequest(Connection& connection, const std::string& request_id,
                                                          const std::string& request_digest) {
  if (request_id.empty()) return std::nullopt;
  auto statement = connection.Prepare("SELECT campaign, digest FROM campaign_requests WHERE request_id = ?");
  if (!statement.ok()) return statement.status();
  const absl::StatusOr<bool> row = statement->Bind(request_id).Step();
  if (!row.ok()) return row.status();
  if (!*row) return std::nullopt;
  const std::string earlier = statement->Text(0);
  if (statement->Text(1) == request_digest) return ReadCampaign(connection, earlier);
  return WithReason(absl::AlreadyExistsError(absl::StrCat("request id ", FormatReceived(request_id),
                                                          " was used for another request, on campaign ", earlier)),
                    "REQUEST_ID_REUSED");
}

absl::StatusOr<std::vector<CampaignRecord>> ReadCampaigns(Connection& connection, const CampaignQuery& query) {
  std::string where;
  std::vector<Statement::Value> values;
  const auto add = [&](std::string_view condition) {
    absl::StrAppend(&where, where.empty() ? " WHERE " : " AND ", ToAbsl(condition));
  };
  std::string places;
  for (const CampaignState state : query.states) {
    absl::StrAppend(&places, places.empty() ? "?" : ", ?");
    values.emplace_back(std::string(NameOf(state)));
  }
  if (!places.empty()) add(absl::StrCat("state IN (", places, ")"));
  if (query.after) {
    add("(create_time_us, id) < (?, ?)");
    values.emplace_back(query.after->create_time_us);
    values.emplace_back(query.after->id);
  }
  values.emplace_back(std::int64_t{query.limit});
  auto statement = connection.PrepareOnce(
      SelectCampaigns("NULL", absl::StrCat(where, " ORDER BY create_time_us DESC, id DESC LIMIT ?")));
  if (!statement.ok()) return statement.status();
  return ReadRecords(connection, statement->BindAll(values));
}

absl::StatusOr<std::vector<CampaignRecord>> ReadUnfinishedCampaigns(Connection& connection) {
  auto statement = connection.Prepare(
      SelectCampaigns("NULL", " WHERE state IN ('RUNNING', 'PAUSED', 'EVALUATING') ORDER BY create_time_us, id"));
  if (!statement.ok()) return statement.status();
  return ReadRecords(connection, *statement);
}

absl::StatusOr<std::vector<CampaignMember>> ReadMembersOf(Connection& connection, const std::string& id, MemberId after,
                                                          int limit) {
  if (const auto last_seq = ReadLastSeq(connection, id); !last_seq.ok()) return last_seq.status();
  auto statement = connection.Prepare(
      "SELECT role, number, initial_condition, jobs.id, episodes "
      "FROM campaign_members LEFT JOIN jobs ON jobs.key = job "
      "WHERE campaign_members.campaign = ? AND (role, number) > (?, ?) ORDER BY role, number LIMIT ?");
  if (!statement.ok()) return statement.status();
  std::vector<CampaignMember> members;
  absl::Status status =
      statement->Bind(id, static_cast<int>(after.role), after.number, std::max(limit, 0)).ForEachRow([&] {
        absl::StatusOr<CampaignMember> member = MemberIn(*statement);
        if (member.ok()) members.push_back(*std::move(member));
        return member.status();
      });
  if (!status.ok()) return InCampaign(id, status);
  return members;
}

absl::StatusOr<std::vector<CampaignEvent>> ReadCampaignEventsOf(Connection& connection, const std::string& id,
                                                                std::int64_t after_seq, int limit) {
  const absl::StatusOr<std::int64_t> last_seq = ReadLastSeq(connection, id);
  if (!last_seq.ok()) return last_seq.status();
  auto statement = connection.Prepare(
      "SELECT seq, time_us, state, role, number, job, message FROM campaign_events "
      "WHERE campaign = ? AND seq > ? ORDER BY seq LIMIT ?");
  if (!statement.ok()) return statement.status();
  std::vector<CampaignEvent> events;
  const std::int64_t after = std::max<std::int64_t>(after_seq, 0);
  absl::Status status = statement->Bind(id, after, std::max(limit, 0)).ForEachRow([&]() -> absl::Status {
    absl::StatusOr<CampaignEvent> event = EventIn(*statement);
    if (!event.ok()) return event.status();
    if (event->seq != after + 1 + static_cast<std::int64_t>(events.size())) {
      return absl::DataLossError(absl::StrCat("event ", event->seq - 1, " is missing from its history"));
    }
    events.push_back(*std::move(event));
    return absl::OkStatus();
  });
  if (!status.ok()) return InCampaign(id, status);
  if (events.empty() || events.back().seq != *last_seq) return events;
  // The results of the last run only: an extension begins anew.
  auto* const end = std::get_if<CampaignStateChange>(&events.back().what);
  if (end == nullptr || end->state != CampaignState::kSucceeded) return events;
  absl::StatusOr<CampaignRecord> campaign = ReadCampaign(connection, id);
  if (!campaign.ok()) return campaign.status();
  end->results = std::move(campaign->results);
  return events;
}

absl::StatusOr<std::vector<std::string>> ReadJobIdsOf(Connection& connection, const std::string& id) {
  auto statement = connection.Prepare(
      "SELECT jobs.id FROM campaign_members JOIN jobs ON jobs.key = job WHERE campaign_members.campaign = ? "
      "ORDER BY role, number");
  if (!statement.ok()) return statement.status();
  std::vector<std::string> ids;
  absl::Status status = statement->Bind(id).ForEachRow([&] {
    ids.push_back(statement->Text(0));
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return ids;
}

}  // namespace orbitune
