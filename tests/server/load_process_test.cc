// What the real binary refuses under load, what it shows at /metrics and says in its log, and how it stops.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <thread>

#include "tests/server/engine_support.h"
#include "tests/server/process_support.h"
#include "tests/server/rest_support.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

class LoadProcessTest : public ::testing::Test {
 protected:
  std::unique_ptr<Server> Start(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"--data-dir", directory_.File("data"), "--listen", "127.0.0.1:0"});
    return std::make_unique<Server>(directory_.File("process-" + std::to_string(++processes_)), arguments);
  }

  TemporaryDirectory directory_;

 private:
  int processes_ = 0;
};

constexpr char kEndlessJob[] = R"({"scenario": "scenarios/gto-geo", "hyperparameters": {"iterations": 10000000}})";

// 429, what is at most allowed in the text, and the option and its value for machines.
void ExpectRefused(const HttpClient::Reply& reply, const std::string& option, const std::string& limit) {
  EXPECT_EQ(reply.code, 429) << reply.body;
  EXPECT_EQ(reply.headers.at("retry-after"), "1");
  const Json error = Json::parse(reply.body).at("error");
  EXPECT_EQ(error.at("status"), "RESOURCE_EXHAUSTED");
  EXPECT_THAT(error.at("message").get<std::string>(), HasSubstr("at most " + limit));
  std::set<std::string> types;
  for (const Json& detail : error.at("details")) {
    types.insert(detail.at("@type"));
    if (!detail.contains("reason")) continue;
    EXPECT_EQ(detail.at("reason"), "LIMIT_EXCEEDED");
    EXPECT_EQ(detail.at("metadata").at("option"), option);
    EXPECT_EQ(detail.at("metadata").at("limit"), limit);
  }
  EXPECT_EQ(types.size(), 2u) << error;  // ErrorInfo, RetryInfo
}

TEST_F(LoadProcessTest, BoundsAreOptionsAndRefusalsNameThem) {
  const auto server =
      Start({"--max-jobs-per-client", "2", "--max-watchers-per-client", "1", "--max-response-bytes", "20000"});
  HttpClient http(server->http_address());
  std::string job;
  for (int i = 0; i < 2; ++i) {
    const HttpClient::Reply reply = http.Post("/v1/jobs", kEndlessJob);
    ASSERT_EQ(reply.code, 200) << reply.body;
    job = Json::parse(reply.body).at("name");
  }
  ExpectRefused(http.Post("/v1/jobs", kEndlessJob), "max-jobs-per-client", "2");
  Client client(server->address());
  v1::CreateJobRequest create = CreateRequest(10);
  const grpc::Status refused = client.Create(create);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_TRUE(DetailsOf(refused).retry);
  EXPECT_EQ(DetailsOf(refused).reason, "LIMIT_EXCEEDED");
  ExpectRefused(http.Post("/v1/episodes:simulate", R"({"scenario": "scenarios/gto-geo", "include_trajectory": true})"),
                "max-response-bytes", "20000");
  {
    EventStream watcher(server->http_address(), "/v1/" + job + ":watch", true);
    EXPECT_EQ(watcher.head().code, 200);
    ExpectRefused(http.Get("/v1/" + job + ":watch", "Accept: text/event-stream\r\n"), "max-watchers-per-client", "1");
  }
  EXPECT_THAT(server->process().err(), HasSubstr("call refused method=CreateJob"));
}

TEST_F(LoadProcessTest, ConnectionsAreBoundedToo) {
  const auto server = Start({"--http-max-connections", "1"});
  HttpClient one(server->http_address());
  EXPECT_EQ(one.Get("/healthz").code, 200);
  HttpClient two(server->http_address());
  ExpectRefused(two.ReadReply(), "http-max-connections", "1");
  EXPECT_EQ(one.Get("/healthz").code, 200);
}

TEST_F(LoadProcessTest, AClientsConnectionsAreBoundedToo) {
  const auto server = Start({"--http-max-connections-per-client", "1"});
  HttpClient one(server->http_address());
  EXPECT_EQ(one.Get("/healthz").code, 200);
  HttpClient two(server->http_address());
  ExpectRefused(two.ReadReply(), "http-max-connections-per-client", "1");
  HttpClient other(server->http_address(), 0, "127.0.0.2");
  EXPECT_EQ(other.Get("/healthz").code, 200);
}

TEST_F(LoadProcessTest, HelpTellsEveryBound) {
  Process help(directory_.File("help"), ServerCommand({"--help"}));
  EXPECT_EQ(help.Wait(), 0);
  for (const char* option : {"max-running-jobs",
                             "max-queued-jobs",
                             "max-jobs-per-client",
                             "max-campaigns-per-client",
                             "max-job-memory-mib",
                             "max-calls-waiting",
                             "max-calls-waiting-per-client",
                             "max-waiting-mib",
                             "max-episode-calls",
                             "max-verifications",
                             "max-request-bytes",
                             "max-response-bytes",
                             "max-watchers",
                             "max-watchers-per-client",
                             "max-streams-per-connection",
                             "grpc-memory-mib",
                             "http-max-connections",
                             "http-max-connections-per-client",
                             "http-max-body-bytes",
                             "log-format",
                             "log-level",
                             "log-slow-call-s"}) {
    EXPECT_THAT(help.out(), HasSubstr(std::string("--") + option + " "));
  }
}

std::map<std::string, double> MetricsOf(const std::string& text) {
  std::map<std::string, double> values;
  const std::regex line(R"(([a-zA-Z_:][a-zA-Z0-9_:]*(?:\{[^}]*\})?) (\S+))");
  const std::regex comment(R"(# (HELP|TYPE) [a-z_]+ .+)");
  std::istringstream lines(text);
  for (std::string each; std::getline(lines, each);) {
    std::smatch match;
    if (std::regex_match(each, match, line)) {
      values[match[1]] = std::stod(match[2]);
    } else {
      EXPECT_TRUE(std::regex_match(each, comment)) << each;
    }
  }
  return values;
}

TEST_F(LoadProcessTest, MetricsTellWhatHappened) {
  const auto server = Start({});
  HttpClient http(server->http_address());
  const std::string job =
      Json::parse(
          http.Post("/v1/jobs", R"({"scenario": "scenarios/gto-geo", "hyperparameters": {"iterations": 30}})").body)
          .at("name");
  Client client(server->address());
  client.WaitForEnd(job);
  EXPECT_EQ(http.Post("/v1/jobs", kEndlessJob).code, 200);
  EXPECT_EQ(http.Get("/v1/jobs/none").code, 404);
  std::map<std::string, double> metrics;
  const HttpClient::Reply reply = http.Get("/metrics");
  EXPECT_EQ(reply.code, 200);
  EXPECT_THAT(reply.headers.at("content-type"), HasSubstr("version=0.0.4"));
  metrics = MetricsOf(reply.body);
  EXPECT_EQ(metrics.at("orbitune_jobs{state=\"running\"}"), 1);
  EXPECT_EQ(metrics.at("orbitune_jobs{state=\"queued\"}"), 0);
  EXPECT_EQ(metrics.at("orbitune_jobs_ended_total{state=\"succeeded\"}"), 1);
  EXPECT_GE(metrics.at("orbitune_iterations_total"), 30);
  EXPECT_GT(metrics.at("orbitune_episodes_total"), metrics.at("orbitune_iterations_total"));
  EXPECT_GT(metrics.at("orbitune_lane_steps_used_total"), 0);
  EXPECT_LE(metrics.at("orbitune_lane_steps_used_total"), metrics.at("orbitune_lane_steps_total"));
  EXPECT_EQ(metrics.at("orbitune_queue_wait_seconds_count"), 2);
  EXPECT_EQ(metrics.at("orbitune_queue_wait_seconds_bucket{le=\"+Inf\"}"), 2);
  EXPECT_GT(metrics.at("orbitune_store_commit_seconds_count"), 0);
  EXPECT_GE(metrics.at("orbitune_store_commit_operations_sum"), 30);
  EXPECT_EQ(metrics.at("orbitune_disk_ok"), 1);
  EXPECT_GT(metrics.at("orbitune_database_bytes{file=\"database\"}"), 0);
  EXPECT_EQ(metrics.at("orbitune_watchers{transport=\"sse\"}"), 0);
  EXPECT_EQ(metrics.at("orbitune_call_seconds_count{method=\"TuningService.CreateJob\",code=\"OK\"}"), 2);
  EXPECT_EQ(metrics.at("orbitune_call_seconds_count{method=\"TuningService.GetJob\",code=\"NOT_FOUND\"}"), 1);
  EXPECT_GT(metrics.at("process_resident_memory_bytes"), 1 << 20);
  EXPECT_GT(metrics.at("process_open_fds"), 5);
  EXPECT_GT(metrics.at("process_threads"), 5);
  std::ofstream(directory_.File("metrics")) << reply.body;
  if (std::system("command -v promtool >/dev/null 2>&1") == 0) {
    EXPECT_EQ(std::system(("promtool check metrics < " + directory_.File("metrics")).c_str()), 0);
  }
}

TEST_F(LoadProcessTest, ARequestIdIsTakenOverOrMadeAndLogged) {
  const auto server = Start({"--log-format", "json", "--log-level", "debug"});
  HttpClient http(server->http_address());
  EXPECT_EQ(http.Get("/v1/jobs", "X-Request-Id: from-http\r\n").headers.at("x-request-id"), "from-http");
  EXPECT_FALSE(http.Get("/v1/jobs").headers.at("x-request-id").empty());
  Client client(server->address());
  grpc::ClientContext context;
  context.AddMetadata("x-request-id", "from-grpc");
  v1::ListJobsResponse jobs;
  ASSERT_TRUE(client.tuning().ListJobs(&context, {}, &jobs).ok());
  const auto metadata = context.GetServerInitialMetadata().find("x-request-id");
  ASSERT_NE(metadata, context.GetServerInitialMetadata().end());
  EXPECT_EQ(std::string(metadata->second.data(), metadata->second.size()), "from-grpc");
  EXPECT_EQ(server->Terminate(), 0);
  // Each line is JSON by itself.
  std::set<std::string> requests, messages;
  std::istringstream lines(server->process().err());
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with('{')) continue;  // gRPC's own, if it has something to say
    const Json entry = Json::parse(line);
    EXPECT_TRUE(entry.contains("time") && entry.contains("level")) << line;
    messages.insert(entry.at("message"));
    requests.insert(entry.value("request", ""));
  }
  EXPECT_TRUE(requests.contains("from-http"));
  EXPECT_TRUE(requests.contains("from-grpc"));
  for (const char* message : {"started", "stopping", "stopped"}) EXPECT_TRUE(messages.contains(message)) << message;
}

// Watchers are told, the job's history is whole, and nothing had to be broken off.
TEST_F(LoadProcessTest, AStopTellsWatchersAndLosesNothing) {
  auto server = Start({});
  Client client(server->address());
  const std::string job = client.Create(10'000'000);
  client.WaitForIterations(job, 3);
  HttpClient idle(server->http_address());
  EXPECT_EQ(idle.Get("/healthz").code, 200);
  const Client idle_grpc(server->address());
  EXPECT_TRUE(idle_grpc.channel()->WaitForConnected(std::chrono::system_clock::now() + std::chrono::minutes(1)));
  Watch watch(client, job);
  v1::WatchJobResponse event;
  ASSERT_TRUE(watch.Read(&event));  // the snapshot
  ASSERT_TRUE(watch.Read(&event));
  EventStream sse(server->http_address(), "/v1/" + job + ":watch", true);
  server->process().Signal(SIGTERM);
  grpc::Status end;
  const auto seen = watch.ReadAll(&end);
  EXPECT_EQ(end.error_code(), grpc::StatusCode::UNAVAILABLE);
  const auto events = sse.ReadAll();
  ASSERT_FALSE(events.empty());
  EXPECT_EQ(events.back().kind, "error");
  EXPECT_EQ(server->process().Wait(), 0);
  EXPECT_THAT(server->process().err(), HasSubstr("stopped"));
  EXPECT_THAT(server->process().err(), Not(HasSubstr("holds the stop up")));
  const std::int64_t last_seen = seen.empty() ? event.seq() : seen.back().seq();
  server = Start({});
  Client again(server->address());
  Watch resumed(again, job, last_seen);
  ASSERT_TRUE(resumed.Read(&event));  // the snapshot
  ASSERT_TRUE(resumed.Read(&event));
  EXPECT_EQ(event.seq(), last_seen + 1);
  resumed.Cancel();
}

}  // namespace
}  // namespace orbitune::server_test
