// Campaigns and gains over HTTP: every route once with what it answers, streams as with jobs, errors by field.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "orbitune/v1/campaign.pb.h"
#include "orbitune/v1/gains.pb.h"
#include "server/api/json.h"
#include "server/rest/server.h"
#include "tests/server/engine_support.h"
#include "tests/server/rest_support.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using Reply = HttpClient::Reply;
using ::testing::HasSubstr;

class RestCampaignGainTest : public ::testing::Test {
 protected:
  RestCampaignGainTest() : engine_(directory_.File("jobs.db")) {
    auto http = HttpServer::Start({.address = "127.0.0.1:0", .log = [](const std::string&) {}}, api_);
    EXPECT_TRUE(http.ok()) << http.status();
    http_ = *std::move(http);
  }
  ~RestCampaignGainTest() override { http_->Shutdown(std::chrono::seconds(2)); }

  Reply Call(const std::string& method, const std::string& target, const std::string& json = "") {
    return HttpClient(http_->address()).Call(method, target, json, "Content-Type: application/json\r\n");
  }

  template <typename Message>
  Message Answer(const std::string& method, const std::string& target, const std::string& json = "") {
    const Reply reply = Call(method, target, json);
    EXPECT_EQ(reply.code, 200) << target << ": " << reply.body;
    Message message;
    EXPECT_TRUE(FromJson(reply.body, &message).ok()) << reply.body;
    return message;
  }

  static std::string CampaignJson(int count, int iterations) {
    v1::Campaign campaign;
    *campaign.mutable_scenario_definition() = SmallDefinition(iterations);
    campaign.mutable_initial_conditions()->mutable_draw()->set_count(count);
    return ToJson(campaign);
  }

  // Watched to its end.
  v1::Campaign Ended(const std::string& path) {
    EventStream(http_->address(), path + ":watch", false).ReadAll();
    return Answer<v1::Campaign>("GET", path);
  }

  TemporaryDirectory directory_;
  Engine engine_;
  Api api_{engine_.use_cases(), engine_.campaigns(), engine_.gains()};
  std::unique_ptr<HttpServer> http_;
};

TEST_F(RestCampaignGainTest, ACampaignsLife) {
  const auto valid = Answer<v1::Campaign>("POST", "/v1/campaigns?validate_only=true", CampaignJson(3, 2));
  EXPECT_EQ(valid.initial_conditions().draw().count(), 3);
  EXPECT_EQ(Answer<v1::ListCampaignsResponse>("GET", "/v1/campaigns").campaigns_size(), 0);

  const auto created = Answer<v1::Campaign>("POST", "/v1/campaigns?request_id=one", CampaignJson(3, 2));
  EXPECT_EQ(Answer<v1::Campaign>("POST", "/v1/campaigns?request_id=one", CampaignJson(3, 2)).name(), created.name());
  const std::string path = "/v1/" + created.name();
  EXPECT_EQ(Ended(path).state(), v1::CAMPAIGN_STATE_SUCCEEDED);
  const auto members = Answer<v1::ListCampaignMembersResponse>("GET", path + "/members?page_size=2");
  EXPECT_EQ(members.members_size(), 2);
  EXPECT_EQ(Answer<v1::ListCampaignMembersResponse>("GET", path + "/members?page_token=" + members.next_page_token())
                .members_size(),
            1);
  const auto list = Answer<v1::ListCampaignsResponse>("GET", "/v1/campaigns?page_size=5");
  ASSERT_EQ(list.campaigns_size(), 1);
  EXPECT_FALSE(list.campaigns(0).has_results());

  const auto extended =
      Answer<v1::Campaign>("POST", path + ":extend", R"({"initial_conditions": {"draw": {"count": 2}}})");
  EXPECT_EQ(extended.state(), v1::CAMPAIGN_STATE_RUNNING);
  EXPECT_EQ(Ended(path).progress().tuned().members(), 5);

  EXPECT_EQ(Call("DELETE", path).code, 200);
  EXPECT_EQ(Call("GET", path).code, 404);
}

TEST_F(RestCampaignGainTest, ACampaignIsPausedResumedAndCancelled) {
  const auto created = Answer<v1::Campaign>("POST", "/v1/campaigns", CampaignJson(2, SearchOptions::kMaxIterations));
  const std::string path = "/v1/" + created.name();
  EXPECT_EQ(Answer<v1::Campaign>("POST", path + ":pause").state(), v1::CAMPAIGN_STATE_PAUSED);
  EXPECT_THAT(Call("POST", path + ":extend", R"({"initial_conditions": {"draw": {"count": 1}}})").body,
              HasSubstr("CAMPAIGN_STATE"));
  EXPECT_EQ(Answer<v1::Campaign>("POST", path + ":resume").state(), v1::CAMPAIGN_STATE_RUNNING);
  EXPECT_EQ(Call("DELETE", path).code, 400);
  EXPECT_EQ(Answer<v1::Campaign>("POST", path + ":cancel").state(), v1::CAMPAIGN_STATE_CANCELLED);
}

// Without snapshots and progress, which are of the moment.
std::string EventsOf(EventStream&& stream) {
  std::string all;
  for (const StreamEvent& event : stream.ReadAll()) {
    if (event.json.find("\"snapshot\"") == std::string::npos && event.json.find("\"progress\"") == std::string::npos) {
      all += event.json + "\n";
    }
  }
  return all;
}

TEST_F(RestCampaignGainTest, ACampaignsEventsAreTheSameAsSseAndAsLinesFromAnySeq) {
  const auto created = Answer<v1::Campaign>("POST", "/v1/campaigns", CampaignJson(3, 2));
  const std::string path = "/v1/" + created.name();
  Ended(path);
  const std::string all = EventsOf(EventStream(http_->address(), path + ":watch", true));
  EXPECT_THAT(all, HasSubstr("member_ended"));
  EXPECT_THAT(all, HasSubstr("CAMPAIGN_STATE_SUCCEEDED"));
  std::size_t begin = 0;
  for (int seq = 0; begin < all.size(); ++seq) {
    const std::string after = path + ":watch?resume_after_seq=" + std::to_string(seq);
    EXPECT_EQ(EventsOf(EventStream(http_->address(), after, true)), all.substr(begin)) << seq;
    EXPECT_EQ(EventsOf(EventStream(http_->address(), after, false)), all.substr(begin)) << seq;
    begin = all.find('\n', begin) + 1;
  }
}

TEST_F(RestCampaignGainTest, GainsAreQueriedListedImportedAndDeleted) {
  v1::QueryGainsRequest query;
  *query.mutable_scenario_definition() = SmallDefinition(2);
  EXPECT_EQ(Answer<v1::QueryGainsResponse>("POST", "/v1/gains:query", ToJson(query)).position().library_size(), 0);

  const auto job = Answer<v1::Job>("POST", "/v1/jobs", ToJson(CreateRequest(2).job()));
  engine_.WaitForEnd(job.name().substr(5));
  const auto answer = Answer<v1::QueryGainsResponse>("POST", "/v1/gains:query", ToJson(query));
  EXPECT_EQ(answer.position().library_size(), 1);
  EXPECT_TRUE(std::ranges::is_sorted(answer.answers(), {}, [](const auto& a) { return a.flight().cost(); }));

  const auto list = Answer<v1::ListGainSetsResponse>("GET", "/v1/gainSets?filter=kind%20%3D%20TUNED");
  ASSERT_EQ(list.gain_sets_size(), 1);
  const std::string path = "/v1/" + list.gain_sets(0).name();
  const auto set = Answer<v1::GainSet>("GET", path);
  EXPECT_EQ(set.job(), job.name());
  EXPECT_EQ(Call("DELETE", path).code, 200);
  EXPECT_EQ(Call("DELETE", path).code, 404);

  v1::ImportGainSetsRequest import;
  *import.add_gain_sets() = set;
  EXPECT_EQ(Answer<v1::ImportGainSetsResponse>("POST", "/v1/gainSets:import", ToJson(import)).imported(), 1);
}

TEST_F(RestCampaignGainTest, WhatIsWrongIsToldByField) {
  const auto refused = [&](const std::string& target, const std::string& json, const std::string& field) {
    const Reply reply = Call("POST", target, json);
    EXPECT_EQ(reply.code, 400) << target;
    EXPECT_THAT(reply.body, HasSubstr("\"field\":\"" + field + "\"")) << target;
  };
  refused("/v1/campaigns", R"({"scenario": "scenarios/none"})", "campaign.scenario");
  refused("/v1/gains:query", R"({"scenario": "scenarios/gto-geo", "max_candidates": 5000})", "max_candidates");
  refused("/v1/gains:query", R"({"scenario": "scenarios/gto-geo", "refine": {"budget_ms": -1}})", "refine.budget_ms");
  EXPECT_EQ(Call("GET", "/v1/campaigns/none").code, 404);
  EXPECT_EQ(Call("GET", "/v1/campaigns/none:watch").code, 404);
  EXPECT_EQ(Call("POST", "/v1/gains:query", "[]").code, 400);
  EXPECT_EQ(Call("PUT", "/v1/gains:query", "{}").code, 405);
}

}  // namespace
}  // namespace orbitune::server_test
