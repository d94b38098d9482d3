#include "client/cli/campaign_fetch.h"

#include "client/cli/parse.h"

namespace orbitune::cli {
namespace {

constexpr int kMemberPage = 500;

}  // namespace

grpc::Status FetchCampaign(const Session& session, const std::string& campaign, v1::Campaign* out) {
  v1::GetCampaignRequest request;
  request.set_name(ResourceName("campaigns", campaign));
  return session.Call(&v1::CampaignService::Stub::GetCampaign, request, out);
}

grpc::Status FetchMembers(const Session& session, const std::string& campaign, std::vector<v1::CampaignMember>* out) {
  v1::ListCampaignMembersRequest request;
  request.set_parent(ResourceName("campaigns", campaign));
  request.set_page_size(kMemberPage);
  do {
    v1::ListCampaignMembersResponse response;
    const grpc::Status status = session.Call(&v1::CampaignService::Stub::ListCampaignMembers, request, &response);
    if (!status.ok()) return status;
    out->insert(out->end(), response.members().begin(), response.members().end());
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  return grpc::Status::OK;
}

}  // namespace orbitune::cli
