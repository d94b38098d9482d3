// orbitune.v1 campaigns, members and their events <-> the domain's.
#pragma once

#include "orbitune/v1/campaign.pb.h"
#include "server/convert/job.h"
#include "server/service/campaign_use_cases.h"

namespace orbitune {

// Output-only fields are ignored. INVALID_ARGUMENT for an enum value that this version does not know.
absl::StatusOr<CampaignRequest> FromProto(const v1::Campaign& campaign);
InitialConditionSource FromProto(const v1::InitialConditions& source);
absl::StatusOr<std::vector<CampaignState>> FromProto(const v1::ListCampaignsRequest& request);

// A record that was only validated has no id, and then no state, times or etag.
void ToProto(const CampaignRecord& record, v1::Campaign* out);
void ToProto(const MemberView& view, v1::CampaignMember* out);
void ToProto(const CampaignEventView& view, v1::WatchCampaignResponse* out);

// How far its jobs have got.
void ToProto(const CampaignRecord& record, v1::CampaignProgress* out);

}  // namespace orbitune
