// The bounds of the API, without a transport: calls and streams beyond them are refused with the limit, and no client
// keeps another waiting; what nobody waits for any more is not run.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <future>
#include <latch>
#include <thread>

#include "google/rpc/error_details.pb.h"
#include "google/rpc/error_info.pb.h"
#include "server/api/api.h"
#include "server/api/error.h"
#include "tests/server/engine_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::ElementsAre;

constexpr Work kKinds[] = {Work::kRead, Work::kWrite, Work::kQuery, Work::kEpisode, Work::kVerify};

Executor::Limits WithLimits(int waiting, int per_client) {
  return {.waiting = {"waiting", waiting}, .waiting_per_client = {"per-client", per_client}};
}

TEST(ExecutorTest, ClientsTakeTurns) {
  std::vector<std::string> order;
  std::latch begun(1), go(1);
  {
    Executor executor(1, WithLimits(100, 100));
    executor.Post([&] {
      begun.count_down();
      go.wait();
    });
    begun.wait();
    for (const char* client : {"a", "a", "a", "a", "b", "c"}) {
      ASSERT_TRUE(executor.TryPost(client, [&order, client] { order.emplace_back(client); }).ok());
    }
    EXPECT_EQ(executor.waiting(), 6u);
    go.count_down();
  }  // runs what is queued
  EXPECT_THAT(order, ElementsAre("a", "b", "c", "a", "a", "a"));
}

TEST(ExecutorTest, OneThreadIsLeftForOthers) {
  std::latch go(1);
  std::promise<void> others;
  Executor executor(3, WithLimits(100, 100));
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(executor.TryPost("a", [&go] { go.wait(); }).ok());
  ASSERT_TRUE(executor.TryPost("b", [&others] { others.set_value(); }).ok());
  others.get_future().wait();  // for ever, if "a" had all three
  while (executor.waiting() > 8) std::this_thread::yield();
  EXPECT_EQ(executor.waiting(), 8u);
  go.count_down();
}

TEST(ExecutorTest, RefusesWhatIsBeyondItsBounds) {
  std::latch begun(1), go(1);
  Executor executor(1, WithLimits(3, 2));
  executor.Post([&] {
    begun.count_down();
    go.wait();
  });
  begun.wait();
  const auto post = [&](const char* client) { return executor.TryPost(client, [] {}); };
  EXPECT_TRUE(post("a").ok());
  EXPECT_TRUE(post("a").ok());
  EXPECT_EQ(LimitOf(post("a"))->option, "per-client");
  EXPECT_TRUE(post("b").ok());
  const absl::Status full = post("c");
  EXPECT_TRUE(absl::IsResourceExhausted(full));
  EXPECT_EQ(LimitOf(full)->option, "waiting");
  EXPECT_EQ(LimitOf(full)->value, 3);
  go.count_down();
}

class LimitsTest : public ::testing::Test {
 protected:
  void Start(const ApiLimits& limits) {
    engine_ = std::make_unique<Engine>(directory_.File("db"), Scheduler::Options{.threads = 1});
    api_ = std::make_unique<Api>(engine_->use_cases(), engine_->campaigns(), engine_->gains(), nullptr, limits);
  }

  static CallContext From(const std::string& peer) { return {.caller = LocalCaller(peer)}; }

  absl::Status Call(const std::string& method, const google::protobuf::Message& request,
                    google::protobuf::Message* response, CallContext context) {
    std::promise<absl::Status> answer;
    api_->Call(*api_->methods().Find("orbitune.v1." + method), std::move(context), request, response,
               [&answer](absl::Status status) { answer.set_value(std::move(status)); });
    return answer.get_future().get();
  }

  std::shared_ptr<Feed> Watch(const std::string& job, const std::string& peer) {
    v1::WatchJobRequest request;
    request.set_name(job);
    return api_->Open(*api_->methods().Find("orbitune.v1.TuningService.WatchJob"), From(peer), request);
  }

  // Of its first batch: OK where it brings something.
  static absl::Status StatusOf(const std::shared_ptr<Feed>& feed) {
    std::promise<absl::Status> first;
    feed->Next(1, [&first](const Feed::Batch& batch) { first.set_value(batch.end.value_or(absl::OkStatus())); });
    return first.get_future().get();
  }

  TemporaryDirectory directory_;
  std::unique_ptr<Engine> engine_;
  std::unique_ptr<Api> api_;
};

TEST_F(LimitsTest, WatchersInAllAndOfOneClient) {
  Start({.watchers = {.max_watchers = 3, .max_watchers_per_client = 2}});
  const std::string job = "jobs/" + engine_->Create(EndlessScenario());
  auto first = Watch(job, "a");
  auto second = Watch(job, "a");
  EXPECT_TRUE(StatusOf(first).ok());
  EXPECT_EQ(LimitOf(StatusOf(Watch(job, "a")))->option, "max-watchers-per-client");
  auto third = Watch(job, "b");
  EXPECT_TRUE(StatusOf(third).ok());
  EXPECT_EQ(LimitOf(StatusOf(Watch(job, "c")))->option, "max-watchers");
  EXPECT_EQ(api_->CountWatchers().by_transport.at("grpc"), 3);
  // One that goes makes room.
  second.reset();
  auto fourth = Watch(job, "a");
  EXPECT_TRUE(StatusOf(fourth).ok());
  for (const auto& feed : {first, third, fourth}) feed->End(absl::CancelledError(""));
}

TEST_F(LimitsTest, AnAnswersSize) {
  Start({.max_response_bytes = 2000});
  v1::SimulateEpisodeRequest request;
  request.set_scenario("scenarios/gto-geo");
  v1::SimulateEpisodeResponse response;
  EXPECT_TRUE(Call("SimulationService.SimulateEpisode", request, &response, From("a")).ok());
  request.set_include_trajectory(true);
  const absl::Status refused = Call("SimulationService.SimulateEpisode", request, &response, From("a"));
  EXPECT_TRUE(absl::IsResourceExhausted(refused)) << refused;
  EXPECT_EQ(LimitOf(refused)->option, "max-response-bytes");
  EXPECT_EQ(response.ByteSizeLong(), 0u);
}

TEST_F(LimitsTest, LargeRequestsAtOnce) {
  Start({.max_waiting_bytes = 100 << 10});
  v1::CreateJobRequest request;
  request.mutable_job()->set_scenario("scenarios/gto-geo");
  request.set_validate_only(true);
  request.mutable_job()->set_display_name(std::string(90 << 10, 'x'));
  v1::Job response;
  EXPECT_TRUE(absl::IsInvalidArgument(Call("TuningService.CreateJob", request, &response, From("a"))));
  request.mutable_job()->set_display_name(std::string(110 << 10, 'x'));
  EXPECT_EQ(LimitOf(Call("TuningService.CreateJob", request, &response, From("a")))->option, "max-waiting-mib");
  request.mutable_job()->set_display_name(std::string(90 << 10, 'x'));  // what was held has been given back
  EXPECT_TRUE(absl::IsInvalidArgument(Call("TuningService.CreateJob", request, &response, From("a"))));
}

TEST_F(LimitsTest, ACallThatNobodyWaitsForIsNotRun) {
  Start({});
  v1::CreateJobRequest request;
  request.mutable_job()->set_scenario("scenarios/gto-geo");
  v1::Job response;
  CallContext context = From("a");
  context.cancelled = [] { return true; };
  EXPECT_TRUE(absl::IsCancelled(Call("TuningService.CreateJob", request, &response, std::move(context))));
  EXPECT_EQ(engine_->scheduler().counts().queued + engine_->scheduler().counts().running, 0);
}

// An episode of seconds ends when its caller goes; so does a campaign's creation.
TEST_F(LimitsTest, LongCallsAskWhetherTheyAreWanted) {
  Start({});
  std::atomic<int> asked = 0;
  CallContext context = From("a");
  context.cancelled = [&asked] { return ++asked > 3; };
  v1::SimulateEpisodeRequest simulate;
  simulate.set_scenario("scenarios/gto-geo");
  v1::SimulateEpisodeResponse episode;
  EXPECT_TRUE(absl::IsCancelled(Call("SimulationService.SimulateEpisode", simulate, &episode, context)));
  asked = 0;
  v1::CreateCampaignRequest create;
  create.mutable_campaign()->set_scenario("scenarios/leo-rendezvous");
  create.mutable_campaign()->mutable_initial_conditions()->mutable_draw()->set_count(10'000);
  v1::Campaign campaign;
  EXPECT_TRUE(absl::IsCancelled(Call("CampaignService.CreateCampaign", create, &campaign, context)));
  EXPECT_LT(asked, 100);
}

TEST_F(LimitsTest, ADrainRefusesAllThatComesAfter) {
  Start({});
  const std::string job = "jobs/" + engine_->Create(EndlessScenario());
  auto watched = Watch(job, "a");
  EXPECT_TRUE(StatusOf(watched).ok());
  api_->Drain();
  while (true) {
    const absl::Status status = StatusOf(watched);
    if (status.ok()) continue;  // what it had taken before
    EXPECT_TRUE(absl::IsUnavailable(status)) << status;
    break;
  }
  v1::CreateJobRequest request;
  request.mutable_job()->set_scenario("scenarios/gto-geo");
  v1::Job response;
  const absl::Status refused = Call("TuningService.CreateJob", request, &response, From("a"));
  EXPECT_TRUE(absl::IsUnavailable(refused)) << refused;
  EXPECT_TRUE(absl::IsUnavailable(StatusOf(Watch(job, "a"))));
  google::rpc::RetryInfo retry;
  EXPECT_TRUE(ToRpcStatus(refused).details(0).UnpackTo(&retry));
}

TEST_F(LimitsTest, ARefusalTellsTheLimitToMachines) {
  const google::rpc::Status status = ToRpcStatus(LimitExceeded("watchers", {"max-watchers", 7}, "try again later"));
  EXPECT_EQ(status.message(), "watchers: at most 7 (the server's --max-watchers); try again later");
  google::rpc::ErrorInfo info;
  google::rpc::RetryInfo retry;
  ASSERT_EQ(status.details_size(), 2);
  ASSERT_TRUE(status.details(0).UnpackTo(&info));
  EXPECT_EQ(info.reason(), "LIMIT_EXCEEDED");
  EXPECT_EQ(info.metadata().at("option"), "max-watchers");
  EXPECT_EQ(info.metadata().at("limit"), "7");
  ASSERT_TRUE(status.details(1).UnpackTo(&retry));
  EXPECT_GT(retry.retry_delay().seconds(), 0);
}

TEST_F(LimitsTest, CampaignsOfOneClient) {
  Start({});
  v1::CreateCampaignRequest create;
  create.mutable_campaign()->set_scenario("scenarios/gto-geo");
  create.mutable_campaign()->mutable_initial_conditions()->mutable_draw()->set_count(1);
  v1::Campaign campaign;
  absl::Status status;
  for (int i = 0; i < Engine::kMostCampaigns; ++i) {
    create.set_request_id(std::to_string(i));
    status = Call("CampaignService.CreateCampaign", create, &campaign, From("a"));
    ASSERT_TRUE(status.ok()) << status;
  }
  // A repeated request gets what it made.
  EXPECT_TRUE(Call("CampaignService.CreateCampaign", create, &campaign, From("a")).ok());
  create.set_request_id("");
  EXPECT_EQ(LimitOf(Call("CampaignService.CreateCampaign", create, &campaign, From("a")))->option,
            "max-campaigns-per-client");
  EXPECT_TRUE(Call("CampaignService.CreateCampaign", create, &campaign, From("b")).ok());
}

TEST_F(LimitsTest, CallsAreCountedByMethodAndCode) {
  Start({});
  v1::GetJobRequest request;
  request.set_name("jobs/none");
  v1::Job response;
  for (int i = 0; i < 3; ++i)
    EXPECT_TRUE(absl::IsNotFound(Call("TuningService.GetJob", request, &response, From("a"))));
  const auto rows = api_->call_metrics().Read();
  ASSERT_EQ(rows.size(), 1u);
  EXPECT_EQ(rows[0].method->name(), "GetJob");
  EXPECT_EQ(rows[0].code, absl::StatusCode::kNotFound);
  std::uint64_t calls = 0;
  for (const std::uint64_t count : rows[0].seconds.counts) calls += count;
  EXPECT_EQ(calls, 3u);
  for (const Work work : kKinds) EXPECT_EQ(api_->executors().For(work).waiting(), 0u);
}

}  // namespace
}  // namespace orbitune::server_test
