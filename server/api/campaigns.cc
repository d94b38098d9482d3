#include "server/api/campaigns.h"

#include "server/api/answer.h"

namespace orbitune {
namespace {

absl::StatusOr<std::string> CampaignId(const std::string& name, std::string_view field = "name") {
  return IdFromName("campaigns", name, field);
}

}  // namespace

void CampaignApi::AddTo(MethodTable& methods) {
  const std::string service = "orbitune.v1.CampaignService.";
  methods.Add(service + "CreateCampaign", Work::kWrite, this, &CampaignApi::CreateCampaign);
  methods.Add(service + "GetCampaign", Work::kRead, this, &CampaignApi::GetCampaign);
  methods.Add(service + "ListCampaigns", Work::kRead, this, &CampaignApi::ListCampaigns);
  methods.Add(service + "PauseCampaign", Work::kWrite, this, &CampaignApi::PauseCampaign);
  methods.Add(service + "ResumeCampaign", Work::kWrite, this, &CampaignApi::ResumeCampaign);
  methods.Add(service + "CancelCampaign", Work::kWrite, this, &CampaignApi::CancelCampaign);
  methods.Add(service + "DeleteCampaign", Work::kWrite, this, &CampaignApi::DeleteCampaign);
  methods.Add(service + "ExtendCampaign", Work::kWrite, this, &CampaignApi::ExtendCampaign);
  methods.AddStream<v1::WatchCampaignResponse>(service + "WatchCampaign", this, &CampaignApi::WatchCampaign);
  methods.Add(service + "ListCampaignMembers", Work::kRead, this, &CampaignApi::ListCampaignMembers);
}

absl::Status CampaignApi::CreateCampaign(const v1::CreateCampaignRequest& request, v1::Campaign* out,
                                         const CallContext& context) {
  auto campaign = FromProto(request.campaign());
  if (!campaign.ok()) return campaign.status();
  campaign->job.owner = context.caller.owner();
  campaign->job.peer = context.caller.peer;
  return Answer(use_cases_.Create(*campaign, request.request_id(), request.validate_only(), context.cancelled), out);
}

absl::Status CampaignApi::GetCampaign(const v1::GetCampaignRequest& request, v1::Campaign* out) {
  const auto id = CampaignId(request.name());
  return id.ok() ? Answer(use_cases_.Get(*id), out) : id.status();
}

absl::Status CampaignApi::ListCampaigns(const v1::ListCampaignsRequest& request, v1::ListCampaignsResponse* out) {
  const auto states = FromProto(request);
  if (!states.ok()) return states.status();
  const auto page = use_cases_.List(request.page_size(), request.page_token(), *states);
  return AnswerPage(page, out, [out] { return out->add_campaigns(); });
}

absl::Status CampaignApi::PauseCampaign(const v1::PauseCampaignRequest& request, v1::Campaign* out) {
  const auto id = CampaignId(request.name());
  return id.ok() ? Answer(use_cases_.Pause(*id, request.etag()), out) : id.status();
}

absl::Status CampaignApi::ResumeCampaign(const v1::ResumeCampaignRequest& request, v1::Campaign* out) {
  const auto id = CampaignId(request.name());
  return id.ok() ? Answer(use_cases_.Resume(*id, request.etag()), out) : id.status();
}

absl::Status CampaignApi::CancelCampaign(const v1::CancelCampaignRequest& request, v1::Campaign* out) {
  const auto id = CampaignId(request.name());
  return id.ok() ? Answer(use_cases_.Cancel(*id, request.etag()), out) : id.status();
}

absl::Status CampaignApi::DeleteCampaign(const v1::DeleteCampaignRequest& request, google::protobuf::Empty*) {
  const auto id = CampaignId(request.name());
  return id.ok() ? use_cases_.Delete(*id, request.etag()) : id.status();
}

absl::Status CampaignApi::ExtendCampaign(const v1::ExtendCampaignRequest& request, v1::Campaign* out,
                                         const Cancelled& cancelled) {
  const auto id = CampaignId(request.name());
  if (!id.ok()) return id.status();
  const InitialConditionSource more = FromProto(request.initial_conditions());
  return Answer(use_cases_.Extend(*id, more, request.request_id(), request.etag(), cancelled), out);
}

std::shared_ptr<Feed> CampaignApi::WatchCampaign(const v1::WatchCampaignRequest& request) {
  return NewCampaignFeed(request, context_);
}

absl::Status CampaignApi::ListCampaignMembers(const v1::ListCampaignMembersRequest& request,
                                              v1::ListCampaignMembersResponse* out) {
  const auto id = CampaignId(request.parent(), "parent");
  if (!id.ok()) return id.status();
  const auto page = use_cases_.ListMembers(*id, request.page_size(), request.page_token());
  return AnswerPage(page, out, [out] { return out->add_members(); });
}

}  // namespace orbitune
