// Whole campaigns over the API.
#pragma once

#include <string>
#include <vector>

#include "client/cli/session.h"

namespace orbitune::cli {

// campaign: ID or campaigns/ID.
grpc::Status FetchCampaign(const Session& session, const std::string& campaign, v1::Campaign* out);

// All of them, in order.
grpc::Status FetchMembers(const Session& session, const std::string& campaign, std::vector<v1::CampaignMember>* out);

}  // namespace orbitune::cli
