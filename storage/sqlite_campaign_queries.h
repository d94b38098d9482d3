// Reads of a campaign, its members and its events from one connection, each within the caller's transaction. Thread
// rule: the connection's. Errors: the connection's; DATA_LOSS where what is read does not fit together; NOT_FOUND for
// an unknown campaign.
#pragma once

#include <string>
#include <vector>

#include "storage/campaign_store.h"
#include "storage/sqlite_connection.h"

namespace orbitune {

absl::Status CampaignNotFound(const std::string& id);

// With its results, if it has them.
absl::StatusOr<CampaignRecord> ReadCampaign(Connection& connection, const std::string& id);

// As CampaignStore::FindRequest.
absl::StatusOr<std::optional<CampaignRecord>> ReadRequest(Connection& connection, const std::string& request_id,
                                                          const std::string& request_digest);

// As CampaignStore::ListCampaigns, ListUnfinishedCampaigns, ListMembers and ListCampaignEvents.
absl::StatusOr<std::vector<CampaignRecord>> ReadCampaigns(Connection& connection, const CampaignQuery& query);
absl::StatusOr<std::vector<CampaignRecord>> ReadUnfinishedCampaigns(Connection& connection);
absl::StatusOr<std::vector<CampaignMember>> ReadMembersOf(Connection& connection, const std::string& id, MemberId after,
                                                          int limit);
absl::StatusOr<std::vector<CampaignEvent>> ReadCampaignEventsOf(Connection& connection, const std::string& id,
                                                                std::int64_t after_seq, int limit);

// Of all its members.
absl::StatusOr<std::vector<std::string>> ReadJobIdsOf(Connection& connection, const std::string& id);

}  // namespace orbitune
