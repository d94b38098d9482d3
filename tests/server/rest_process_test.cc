// HTTP from the real binary: hundreds of watchers, hostile clients, and what they cost in memory; stops and restarts.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <thread>

#include "server/api/json.h"
#include "tests/server/engine_support.h"
#include "tests/server/process_support.h"
#include "tests/server/rest_support.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

#ifdef __SANITIZE_ADDRESS__
constexpr double kMemoryFactor = 20;  // freed memory is kept for a while
#else
constexpr double kMemoryFactor = 1;
#endif

class RestProcessTest : public ::testing::Test {
 protected:
  std::unique_ptr<Server> Start(const std::string& http = "127.0.0.1:0") {
    return std::make_unique<Server>(
        directory_.File("process-" + std::to_string(++processes_)),
        std::vector<std::string>{"--data-dir", directory_.File("data"), "--listen", "127.0.0.1:0", "--http", http});
  }

  TemporaryDirectory directory_;

 private:
  int processes_ = 0;
};

HttpClient::Reply Post(const std::string& address, const std::string& target, const std::string& json) {
  return HttpClient(address).Post(target, json);
}

std::string CreateGtoGeo(const std::string& address, int iterations) {
  v1::Job job;
  job.set_scenario("scenarios/gto-geo");
  job.mutable_hyperparameters()->set_iterations(iterations);
  const HttpClient::Reply reply = Post(address, "/v1/jobs", ToJson(job));
  EXPECT_EQ(reply.code, 200) << reply.body;
  EXPECT_TRUE(FromJson(reply.body, &job).ok());
  return job.name();
}

// Everything that is under "data:", but for the snapshot.
std::string EventsOf(EventStream& stream) {
  std::string all;
  for (StreamEvent event; stream.Read(&event);) {
    if (event.kind != "snapshot") all += event.json + "\n";
  }
  return all;
}

TEST_F(RestProcessTest, FiveHundredWatchersOfARunningJobEachGetEveryEvent) {
  constexpr int kWatchers = 500;
  const auto server = Start();
  const std::string name = CreateGtoGeo(server->http_address(), 600);
  std::vector<std::string> seen(kWatchers);
  std::vector<std::thread> watchers;
  for (std::string& events : seen) {
    watchers.emplace_back([&] {
      EventStream stream(server->http_address(), "/v1/" + name + ":watch", true);
      events = EventsOf(stream);
      EXPECT_TRUE(stream.ended_well());
    });
  }
  for (std::thread& watcher : watchers) watcher.join();
  EXPECT_EQ(LinesOf(seen[0]).size(), 603u);
  EXPECT_EQ(std::ranges::count(seen, seen[0]), kWatchers);
  EXPECT_LT(server->process().peak_memory_mib(), 150 * kMemoryFactor);
  EXPECT_EQ(server->Terminate(), 0);
}

TEST_F(RestProcessTest, HostileClientsCostNoMemory) {
  const auto server = Start();
  const std::string& http = server->http_address();
  EXPECT_EQ(HttpClient(http).Get("/v1/scenarios").code, 200);
  const double before = server->process().peak_memory_mib();
  std::string headers;
  for (int i = 0; i < 10'000; ++i) headers += "X-Header-" + std::to_string(i) + ": value\r\n";
  const std::string post = "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n";
  std::vector<std::unique_ptr<HttpClient>> slow;
  for (int i = 0; i < 200; ++i) {
    EXPECT_EQ(HttpClient(http).Get("/healthz", headers).code, 431);
    HttpClient huge(http);
    huge.Send(post + "Content-Length: 1073741824\r\n\r\n{");
    EXPECT_EQ(huge.ReadReply().code, 413);
    EXPECT_EQ(HttpClient(http).Get("/../../../../etc/passwd").code, 404);
    EXPECT_EQ(Post(http, "/v1/jobs", std::string(5000, '[')).code, 400);
    slow.push_back(std::make_unique<HttpClient>(http));
    slow.back()->Send(post + "Content-Length: 10000000\r\n\r\n" + std::string(1000, ' '));
  }
  EXPECT_LT(server->process().peak_memory_mib(), before + 30 * kMemoryFactor);
  EXPECT_EQ(HttpClient(http).Get("/healthz").code, 200);
  EXPECT_EQ(server->Terminate(), 0) << "with requests half sent";
}

// As a browser does, through kills of the server.
TEST_F(RestProcessTest, AStreamResumesAfterAKillWithoutAGapOrADouble) {
  std::string name;
  std::string http = "127.0.0.1:0";
  std::string last_event_id;
  std::string seen;
  for (const std::size_t kill_after : {50u, 400u, 1'000'000u}) {
    const auto server = Start(http);
    http = server->http_address();
    if (name.empty()) name = CreateGtoGeo(http, 1500);
    const std::string header = last_event_id.empty() ? "" : "Last-Event-ID: " + last_event_id + "\r\n";
    EventStream stream(http, "/v1/" + name + ":watch", true, header);
    std::size_t count = 0;
    for (StreamEvent event; stream.Read(&event);) {
      last_event_id = event.id;
      if (event.kind != "snapshot") seen += event.json + "\n";
      if (++count == kill_after) server->KillHard();
    }
    if (kill_after < 1'000'000) continue;
    EventStream again(http, "/v1/" + name + ":watch", true);
    EXPECT_EQ(seen, EventsOf(again));
    EXPECT_EQ(LinesOf(seen).size(), std::stoul(last_event_id));
  }
}

TEST_F(RestProcessTest, AStopEndsStreamsAndHttpCanBeOff) {
  {
    const auto server = Start();
    EventStream stream(server->http_address(),
                       "/v1/" + CreateGtoGeo(server->http_address(), SearchOptions::kMaxIterations) + ":watch", true);
    StreamEvent event;
    ASSERT_TRUE(stream.Read(&event));
    std::thread reader([&] {
      while (stream.Read(&event)) {
      }
    });
    EXPECT_EQ(server->Terminate(), 0);
    reader.join();
    EXPECT_THAT(server->process().out(), HasSubstr("stopping"));
    EXPECT_TRUE(stream.ended_well());
    EXPECT_THAT(server->process().err(),
                AllOf(HasSubstr("stopped"), Not(HasSubstr(" error ")), Not(HasSubstr(" warn"))));
  }
  const auto off = Start("off");
  EXPECT_EQ(off->http_address(), "off");
}

}  // namespace
}  // namespace orbitune::server_test
