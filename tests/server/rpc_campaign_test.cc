// CampaignService over a connection: the resource's life, the watch, errors by field.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "orbitune/v1/campaign.grpc.pb.h"
#include "server/convert/campaign.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::HasSubstr;

class RpcCampaignTest : public RpcServiceTest<v1::CampaignService> {
 protected:
  // So many draws of the small scenario.
  static v1::CreateCampaignRequest Request(int count, int iterations, int held_out = 0) {
    v1::CreateCampaignRequest request;
    *request.mutable_campaign()->mutable_scenario_definition() = SmallDefinition(iterations);
    request.mutable_campaign()->mutable_initial_conditions()->mutable_draw()->set_count(count);
    request.mutable_campaign()->mutable_initial_conditions()->mutable_draw()->set_seed(3);
    if (held_out > 0) request.mutable_campaign()->mutable_held_out()->mutable_draw()->set_count(held_out);
    return request;
  }

  v1::Campaign Create(const v1::CreateCampaignRequest& request) {
    v1::Campaign campaign;
    const grpc::Status status = Call(&Stub::CreateCampaign, request, &campaign);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return campaign;
  }

  std::vector<v1::WatchCampaignResponse> WatchToEnd(const std::string& name, std::int64_t after, grpc::Status* status) {
    grpc::ClientContext context;
    v1::WatchCampaignRequest request;
    request.set_name(name);
    request.set_resume_after_seq(after);
    const auto reader = stub_->WatchCampaign(&context, request);
    std::vector<v1::WatchCampaignResponse> messages;
    for (v1::WatchCampaignResponse message; reader->Read(&message);) messages.push_back(message);
    *status = reader->Finish();
    return messages;
  }
};

TEST_F(RpcCampaignTest, IsCreatedWatchedListedAndDeleted) {
  v1::CreateCampaignRequest create = Request(4, 10, 2);
  create.set_request_id("one");
  const v1::Campaign created = Create(create);
  EXPECT_THAT(created.name(), testing::StartsWith("campaigns/"));
  EXPECT_EQ(created.progress().tuned().members(), 4);
  grpc::Status status;
  const auto messages = WatchToEnd(created.name(), 0, &status);
  EXPECT_TRUE(status.ok()) << status.error_message();
  ASSERT_TRUE(messages.front().has_snapshot());
  std::int64_t seq = 0;
  int ended = 0;
  for (const v1::WatchCampaignResponse& message : messages) {
    if (message.has_snapshot()) continue;
    if (message.has_progress()) {
      EXPECT_EQ(message.seq(), seq);
      continue;
    }
    ASSERT_EQ(message.seq(), ++seq);
    if (!message.has_member_ended()) continue;
    ++ended;
    EXPECT_EQ(message.member_ended().job_state(), v1::JOB_STATE_SUCCEEDED);
    EXPECT_EQ(message.member_ended().episodes().size(), 3);
    EXPECT_TRUE(message.member_ended().has_initial_condition());
  }
  EXPECT_EQ(ended, 4);
  const v1::CampaignStateChange& end = messages.back().state_change();
  EXPECT_EQ(end.state(), v1::CAMPAIGN_STATE_SUCCEEDED);
  EXPECT_EQ(end.results().mean_of(), 4);
  EXPECT_EQ(end.results().best_on_held_out() == v1::GAINS_CHOICE_UNSPECIFIED, false);

  v1::GetCampaignRequest get;
  get.set_name(created.name());
  v1::Campaign campaign;
  ASSERT_TRUE(Call(&Stub::GetCampaign, get, &campaign).ok());
  EXPECT_EQ(campaign.results().SerializeAsString(), end.results().SerializeAsString());
  EXPECT_EQ(campaign.last_seq(), seq);
  EXPECT_EQ(campaign.initial_conditions().draw().count(), 4);
  EXPECT_TRUE(campaign.initial_conditions().draw().distribution().has_equinoctial());

  v1::ListCampaignMembersRequest list;
  list.set_parent(created.name());
  v1::ListCampaignMembersResponse members;
  ASSERT_TRUE(Call(&Stub::ListCampaignMembers, list, &members).ok());
  ASSERT_EQ(members.members().size(), 6);
  EXPECT_EQ(members.members(0).episodes().size(), 4);  // K(1), K*, best, K-hat
  EXPECT_EQ(members.members(5).role(), v1::MEMBER_ROLE_HELD_OUT);
  EXPECT_EQ(members.members(5).job(), "");
  v1::GetJobRequest get_job;
  get_job.set_name(members.members(0).job());
  EXPECT_EQ(client_->Get(members.members(0).job()).campaign(), created.name());

  // The rest of the story after any event, and nothing after the last.
  const auto rest = WatchToEnd(created.name(), seq - 1, &status);
  ASSERT_EQ(rest.size(), 2u);
  EXPECT_EQ(rest[1].seq(), seq);
  EXPECT_EQ(WatchToEnd(created.name(), seq, &status).size(), 1u);
  WatchToEnd(created.name(), seq + 1, &status);
  EXPECT_EQ(DetailsOf(status).violations.at(0).field(), "resume_after_seq");

  EXPECT_EQ(Create(create).name(), created.name());
  create.mutable_campaign()->set_display_name("another");
  status = Call(&Stub::CreateCampaign, create, &campaign);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::ALREADY_EXISTS);
  EXPECT_EQ(DetailsOf(status).reason, "REQUEST_ID_REUSED");

  v1::DeleteCampaignRequest remove;
  remove.set_name(created.name());
  google::protobuf::Empty empty;
  EXPECT_TRUE(Call(&Stub::DeleteCampaign, remove, &empty).ok());
  v1::ListCampaignsResponse campaigns;
  ASSERT_TRUE(Call(&Stub::ListCampaigns, v1::ListCampaignsRequest(), &campaigns).ok());
  EXPECT_EQ(campaigns.campaigns().size(), 0);
}

TEST_F(RpcCampaignTest, AnExtensionGoesOnInTheSameSequence) {
  const v1::Campaign created = Create(Request(2, 5));
  grpc::Status status;
  const std::int64_t end = WatchToEnd(created.name(), 0, &status).back().seq();
  v1::ExtendCampaignRequest extend;
  extend.set_name(created.name());
  extend.mutable_initial_conditions()->mutable_draw()->set_count(1);
  v1::Campaign extended;
  ASSERT_TRUE(Call(&Stub::ExtendCampaign, extend, &extended).ok());
  // The end before is no end any more.
  const auto messages = WatchToEnd(created.name(), 0, &status);
  EXPECT_TRUE(status.ok());
  EXPECT_GT(messages.back().seq(), end + 2);
  EXPECT_EQ(messages.back().state_change().results().mean_of(), 3);
}

TEST_F(RpcCampaignTest, PausesResumesAndCancels) {
  const v1::Campaign created = Create(Request(3, SearchOptions::kMaxIterations));
  v1::Campaign campaign;
  v1::PauseCampaignRequest pause;
  pause.set_name(created.name());
  pause.set_etag("old");
  EXPECT_EQ(Call(&Stub::PauseCampaign, pause, &campaign).error_code(), grpc::StatusCode::ABORTED);
  pause.set_etag(created.etag());
  ASSERT_TRUE(Call(&Stub::PauseCampaign, pause, &campaign).ok());
  EXPECT_EQ(campaign.state(), v1::CAMPAIGN_STATE_PAUSED);
  pause.clear_etag();
  grpc::Status status = Call(&Stub::PauseCampaign, pause, &campaign);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(DetailsOf(status).reason, "CAMPAIGN_STATE");
  v1::ResumeCampaignRequest resume;
  resume.set_name(created.name());
  ASSERT_TRUE(Call(&Stub::ResumeCampaign, resume, &campaign).ok());
  EXPECT_EQ(campaign.state(), v1::CAMPAIGN_STATE_RUNNING);
  v1::CancelCampaignRequest cancel;
  cancel.set_name(created.name());
  ASSERT_TRUE(Call(&Stub::CancelCampaign, cancel, &campaign).ok());
  EXPECT_EQ(campaign.progress().tuned().ended(), 3);
  EXPECT_EQ(WatchToEnd(created.name(), 0, &status).back().state_change().state(), v1::CAMPAIGN_STATE_CANCELLED);
}

TEST_F(RpcCampaignTest, FaultsAreNamedByField) {
  v1::Campaign campaign;
  v1::CreateCampaignRequest request = Request(0, 5);
  grpc::Status status = Call(&Stub::CreateCampaign, request, &campaign);
  ASSERT_EQ(DetailsOf(status).violations.size(), 1u) << status.error_message();
  EXPECT_EQ(DetailsOf(status).violations[0].field(), "campaign.initial_conditions.draw.count");
  EXPECT_THAT(DetailsOf(status).violations[0].description(), HasSubstr("got 0"));
  request = Request(2, 5);
  request.mutable_campaign()->mutable_robust()->mutable_hyperparameters()->mutable_cma_es()->set_population(2);
  status = Call(&Stub::CreateCampaign, request, &campaign);
  ASSERT_EQ(DetailsOf(status).violations.size(), 1u) << status.error_message();
  EXPECT_EQ(DetailsOf(status).violations[0].field(), "campaign.robust.hyperparameters.cma_es.population");
  v1::GetCampaignRequest get;
  get.set_name("campaigns/none");
  EXPECT_EQ(Call(&Stub::GetCampaign, get, &campaign).error_code(), grpc::StatusCode::NOT_FOUND);
  get.set_name("none");
  EXPECT_EQ(DetailsOf(Call(&Stub::GetCampaign, get, &campaign)).violations.at(0).field(), "name");
  v1::ListCampaignsRequest list;
  list.add_states(static_cast<v1::CampaignState>(99));
  v1::ListCampaignsResponse campaigns;
  EXPECT_EQ(DetailsOf(Call(&Stub::ListCampaigns, list, &campaigns)).violations.at(0).field(), "states");
}

TEST_F(RpcCampaignTest, ValidateOnlyTellsWhatWouldRun) {
  v1::CreateCampaignRequest request = Request(3, 5, 1);
  request.mutable_campaign()->mutable_robust();
  request.set_validate_only(true);
  const v1::Campaign campaign = Create(request);
  EXPECT_EQ(campaign.name(), "");
  EXPECT_EQ(campaign.progress().tuned().members(), 3);
  EXPECT_EQ(campaign.robust().hyperparameters().algorithm(), v1::ALGORITHM_CMA_ES);
  EXPECT_EQ(campaign.robust().hyperparameters().max_episodes(), 18'000);
  EXPECT_TRUE(campaign.robust().objective().relative_to_initial());
}

}  // namespace
}  // namespace orbitune::server_test
