// CampaignService in protobuf, without a transport: decode, call the use case, encode. The methods are as the proto
// says.
#pragma once

#include "google/protobuf/empty.pb.h"
#include "server/api/campaign_feed.h"
#include "server/api/methods.h"

namespace orbitune {

// Thread-safe. Unary methods may block.
class CampaignApi {
 public:
  // What `context` refers to outlives this.
  explicit CampaignApi(const CampaignFeedContext& context) : context_(context), use_cases_(context.use_cases) {}

  void AddTo(MethodTable& methods);

 private:
  absl::Status CreateCampaign(const v1::CreateCampaignRequest& request, v1::Campaign* out, const CallContext& context);
  absl::Status GetCampaign(const v1::GetCampaignRequest& request, v1::Campaign* out);
  absl::Status ListCampaigns(const v1::ListCampaignsRequest& request, v1::ListCampaignsResponse* out);
  absl::Status PauseCampaign(const v1::PauseCampaignRequest& request, v1::Campaign* out);
  absl::Status ResumeCampaign(const v1::ResumeCampaignRequest& request, v1::Campaign* out);
  absl::Status CancelCampaign(const v1::CancelCampaignRequest& request, v1::Campaign* out);
  absl::Status DeleteCampaign(const v1::DeleteCampaignRequest& request, google::protobuf::Empty* out);
  absl::Status ExtendCampaign(const v1::ExtendCampaignRequest& request, v1::Campaign* out, const Cancelled& cancelled);
  std::shared_ptr<Feed> WatchCampaign(const v1::WatchCampaignRequest& request);
  absl::Status ListCampaignMembers(const v1::ListCampaignMembersRequest& request, v1::ListCampaignMembersResponse* out);

  const CampaignFeedContext context_;
  CampaignUseCases& use_cases_;
};

}  // namespace orbitune
