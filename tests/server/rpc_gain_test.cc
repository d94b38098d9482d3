// GainService over a connection: what a finished job and a campaign leave, queries, import, errors by field.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "orbitune/v1/campaign.grpc.pb.h"
#include "orbitune/v1/gains.grpc.pb.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

class RpcGainTest : public RpcServiceTest<v1::GainService> {
 protected:
  // A finished job of the small scenario; its id is its gain set's, too.
  std::string FinishedJob() {
    const std::string id = client_->Create(2);
    engine_.WaitForEnd(id.substr(id.find('/') + 1));
    return id.substr(id.find('/') + 1);
  }

  static v1::QueryGainsRequest Query() {
    v1::QueryGainsRequest request;
    *request.mutable_scenario_definition() = SmallDefinition(2);
    return request;
  }

  v1::GainSet Get(const std::string& name) {
    v1::GetGainSetRequest request;
    request.set_name(name);
    v1::GainSet set;
    const grpc::Status status = Call(&Stub::GetGainSet, request, &set);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return set;
  }
};

TEST_F(RpcGainTest, WithNothingStoredSaysSoAndFliesTheInitialGains) {
  v1::QueryGainsResponse answer;
  ASSERT_TRUE(Call(&Stub::QueryGains, Query(), &answer).ok());
  EXPECT_EQ(answer.position().library_size(), 0);
  EXPECT_FALSE(answer.message().empty());
  ASSERT_EQ(answer.answers_size(), 1);
  EXPECT_EQ(answer.answers(0).source(), v1::CANDIDATE_SOURCE_INITIAL);
}

TEST_F(RpcGainTest, AJobsGainsAreFoundAndFlownFromWhereItWasTuned) {
  const std::string id = FinishedJob();
  const v1::Job job = client_->Get("jobs/" + id);
  v1::QueryGainsResponse answer;
  ASSERT_TRUE(Call(&Stub::QueryGains, Query(), &answer).ok());
  EXPECT_EQ(answer.position().library_size(), 1);
  EXPECT_EQ(answer.position().nearest_distance(), 0);
  const auto stored = std::ranges::find_if(answer.answers(), [&](const v1::GainAnswer& a) {
    return a.source() == v1::CANDIDATE_SOURCE_STORED && a.gain_set() == "gainSets/" + id;
  });
  ASSERT_NE(stored, answer.answers().end());
  EXPECT_EQ(stored->gains().SerializeAsString(), job.report().best().gains().SerializeAsString());
  EXPECT_NEAR(stored->flight().cost(), job.report().best().result().cost(), 1e-5 * stored->flight().cost());
  for (int i = 1; i < answer.answers_size(); ++i) {
    EXPECT_LE(answer.answers(i - 1).flight().cost(), answer.answers(i).flight().cost());
  }
}

TEST_F(RpcGainTest, AGainSetOutlivesItsJobAndIsListedReadAndDeleted) {
  const std::string id = FinishedJob();
  client_->Delete("jobs/" + id);
  const v1::GainSet set = Get("gainSets/" + id);
  EXPECT_EQ(set.kind(), v1::GAIN_SET_KIND_TUNED);
  EXPECT_EQ(set.job(), "jobs/" + id);
  EXPECT_FALSE(set.scenario_digest().empty());
  v1::ListGainSetsRequest list;
  list.set_filter("kind = TUNED");
  v1::ListGainSetsResponse listed;
  ASSERT_TRUE(Call(&Stub::ListGainSets, list, &listed).ok());
  ASSERT_EQ(listed.gain_sets_size(), 1);
  EXPECT_EQ(listed.gain_sets(0).name(), set.name());
  v1::DeleteGainSetRequest remove;
  remove.set_name(set.name());
  google::protobuf::Empty empty;
  EXPECT_TRUE(Call(&Stub::DeleteGainSet, remove, &empty).ok());
  EXPECT_EQ(Call(&Stub::DeleteGainSet, remove, &empty).error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(RpcGainTest, ImportsAllOrNothingAndFliesEachAgain) {
  const std::string id = FinishedJob();
  v1::GainSet set = Get("gainSets/" + id);
  v1::DeleteGainSetRequest remove;
  remove.set_name(set.name());
  google::protobuf::Empty empty;
  ASSERT_TRUE(Call(&Stub::DeleteGainSet, remove, &empty).ok());

  v1::ImportGainSetsRequest request;
  *request.add_gain_sets() = set;
  *request.add_gain_sets() = set;
  request.mutable_gain_sets(1)->mutable_gains()->set_k3(-1);
  v1::ImportGainSetsResponse imported;
  const grpc::Status refused = Call(&Stub::ImportGainSets, request, &imported);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(DetailsOf(refused).violations[0].field(), testing::HasSubstr("gain_sets[1].gains.k3"));
  v1::ListGainSetsResponse listed;
  ASSERT_TRUE(Call(&Stub::ListGainSets, {}, &listed).ok());
  EXPECT_EQ(listed.gain_sets_size(), 0) << "the first was imported though the second was refused";

  request.mutable_gain_sets()->RemoveLast();
  request.mutable_gain_sets(0)->mutable_flight()->set_cost(1);  // what it claims does not count
  ASSERT_TRUE(Call(&Stub::ImportGainSets, request, &imported).ok());
  ASSERT_EQ(imported.imported(), 1);
  EXPECT_EQ(imported.gain_sets(0).kind(), v1::GAIN_SET_KIND_IMPORTED);
  EXPECT_NEAR(imported.gain_sets(0).flight().cost(), set.flight().cost(), 1e-5 * set.flight().cost());
}

TEST_F(RpcGainTest, ACampaignLeavesItsMean) {
  const auto campaigns = v1::CampaignService::NewStub(client_->channel());
  v1::CreateCampaignRequest create;
  *create.mutable_campaign()->mutable_scenario_definition() = SmallDefinition(2);
  create.mutable_campaign()->mutable_initial_conditions()->mutable_draw()->set_count(3);
  v1::Campaign campaign;
  grpc::ClientContext context;
  ASSERT_TRUE(campaigns->CreateCampaign(&context, create, &campaign).ok());
  v1::WatchCampaignRequest watch;
  watch.set_name(campaign.name());
  grpc::ClientContext watching;
  const auto reader = campaigns->WatchCampaign(&watching, watch);
  for (v1::WatchCampaignResponse message; reader->Read(&message);) {
  }
  ASSERT_TRUE(reader->Finish().ok());
  v1::ListGainSetsRequest list;
  list.set_filter("campaign = " + campaign.name());
  v1::ListGainSetsResponse listed;
  ASSERT_TRUE(Call(&Stub::ListGainSets, list, &listed).ok());
  EXPECT_EQ(std::ranges::count_if(listed.gain_sets(),
                                  [](const v1::GainSet& s) { return s.kind() == v1::GAIN_SET_KIND_MEAN; }),
            1);
  EXPECT_EQ(listed.gain_sets_size(), 4);
}

TEST_F(RpcGainTest, BadQueriesNameTheField) {
  v1::QueryGainsRequest request = Query();
  request.set_max_candidates(5000);
  request.mutable_refine()->set_budget_ms(-1);
  v1::QueryGainsResponse answer;
  const grpc::Status status = Call(&Stub::QueryGains, request, &answer);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  std::vector<std::string> fields;
  for (const auto& violation : DetailsOf(status).violations) fields.push_back(violation.field());
  EXPECT_THAT(fields, testing::UnorderedElementsAre("max_candidates", "refine.budget_ms"));
}

}  // namespace
}  // namespace orbitune::server_test
