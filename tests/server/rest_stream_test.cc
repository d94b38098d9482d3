// Streams over HTTP against a server in this process: the same events as over gRPC, byte for byte, from anywhere on.
#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <atomic>
#include <mutex>
#include <thread>

#include "server/api/json.h"
#include "tests/server/rest_support.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::HasSubstr;

class RestStreamTest : public RpcServerTest {
 protected:
  RestStreamTest() { Start({}); }
  ~RestStreamTest() override { http_->Shutdown(std::chrono::seconds(2)); }

  void Start(HttpOptions options) {
    options.address = "127.0.0.1:0";
    options.log = [this](const std::string& line) {
      const std::lock_guard lock(mutex_);
      log_ += line + "\n";
    };
    auto http = HttpServer::Start(std::move(options), api_);
    ASSERT_TRUE(http.ok()) << http.status();
    http_ = *std::move(http);
  }
  std::string log() {
    const std::lock_guard lock(mutex_);
    return log_;
  }

  std::string Target(const std::string& name, std::int64_t after = 0) {
    return "/v1/" + name + ":watch?resume_after_seq=" + std::to_string(after);
  }
  EventStream Open(const std::string& name, bool sse, std::int64_t after = 0) {
    return EventStream(http_->address(), Target(name, after), sse);
  }
  // What gRPC gives, as JSON.
  std::vector<std::string> OverGrpc(const std::string& name, std::int64_t after) {
    grpc::Status status;
    std::vector<std::string> events;
    for (const auto& event : Watch(*client_, name, after).ReadAll(&status)) events.push_back(ToJson(event));
    EXPECT_TRUE(status.ok()) << status.error_message();
    return events;
  }
  std::vector<std::string> OverHttp(const std::string& name, bool sse, std::int64_t after) {
    EventStream stream = Open(name, sse, after);
    std::vector<std::string> events;
    for (const StreamEvent& event : stream.ReadAll()) events.push_back(event.json);
    EXPECT_TRUE(stream.ended_well());
    return events;
  }

  std::unique_ptr<HttpServer> http_;

 private:
  std::mutex mutex_;
  std::string log_;  // guarded by mutex_
};

std::int64_t SeqOf(const std::string& json) {
  const std::string begin = "{\"seq\":\"";
  EXPECT_TRUE(json.starts_with(begin)) << json;
  return std::stoll(json.substr(begin.size()));
}

TEST_F(RestStreamTest, TheSameBytesOverGrpcSseAndNdjsonFromAnySeq) {
  const std::string name = client_->Create(700);  // more than the hub keeps
  const std::int64_t last = client_->WaitForEnd(name).last_seq();
  for (const std::int64_t after : {std::int64_t{-1}, std::int64_t{0}, std::int64_t{1}, std::int64_t{2},
                                   std::int64_t{255}, std::int64_t{256}, last - 1, last}) {
    const std::vector<std::string> expected = OverGrpc(name, after);
    EXPECT_EQ(expected.size(), static_cast<std::size_t>(after == -1 ? 1 : last - after + 1));
    EXPECT_EQ(OverHttp(name, true, after), expected) << after;
    EXPECT_EQ(OverHttp(name, false, after), expected) << after;
  }
}

TEST_F(RestStreamTest, TheSameBytesWhileTheJobRuns) {
  const std::string name = client_->Create(1500);
  std::vector<std::vector<std::string>> seen(9);
  std::vector<std::thread> watchers;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    watchers.emplace_back([&, i] { seen[i] = i % 3 == 0 ? OverGrpc(name, 0) : OverHttp(name, i % 3 == 1, 0); });
  }
  for (std::thread& watcher : watchers) watcher.join();
  for (std::vector<std::string>& events : seen) {
    events.erase(events.begin());  // the snapshot is as old as its watcher
    EXPECT_EQ(events, seen[0]);
    for (std::size_t k = 0; k < events.size(); ++k) ASSERT_EQ(SeqOf(events[k]), static_cast<std::int64_t>(k) + 1);
  }
  EXPECT_EQ(seen[0].size(), 1503u);
}

TEST_F(RestStreamTest, SseTellsKindAndWhereToResume) {
  const std::string name = client_->Create(2);
  client_->WaitForEnd(name);
  EventStream stream = Open(name, true, 1);
  const auto events = stream.ReadAll();
  EXPECT_EQ(stream.head().headers.at("cache-control"), "no-store");
  EXPECT_EQ(stream.head().headers.at("x-accel-buffering"), "no");
  ASSERT_EQ(events.size(), 5u);
  // The snapshot's id is where the stream began, not the job's last seq: who resumes there has missed nothing.
  const std::vector<std::pair<std::string, std::string>> expected = {
      {"1", "snapshot"}, {"2", "state_change"}, {"3", "iteration"}, {"4", "iteration"}, {"5", "state_change"}};
  for (std::size_t i = 0; i < events.size(); ++i) {
    EXPECT_EQ(events[i].id, expected[i].first);
    EXPECT_EQ(events[i].kind, expected[i].second);
    if (i > 0) {
      EXPECT_EQ(std::to_string(SeqOf(events[i].json)), events[i].id);
    }
  }
}

TEST_F(RestStreamTest, ABatchHasTheIdOfItsLastIteration) {
  const std::string name = client_->Create(5);
  client_->WaitForEnd(name);
  engine_.store().Flush();
  EventStream stream(http_->address(), Target(name, 1) + "&max_iterations_per_message=3", true);
  const std::vector<std::pair<std::string, std::string>> expected = {{"1", "snapshot"},
                                                                     {"2", "state_change"},
                                                                     {"5", "iteration_batch"},
                                                                     {"7", "iteration_batch"},
                                                                     {"8", "state_change"}};
  std::vector<std::pair<std::string, std::string>> seen;
  v1::ListIterationsResponse iterations;
  for (const StreamEvent& event : stream.ReadAll()) {
    seen.emplace_back(event.id, event.kind);
    v1::WatchJobResponse message;
    ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(event.json, &message).ok()) << event.json;
    iterations.mutable_iterations()->MergeFrom(message.iteration_batch().iterations());
  }
  EXPECT_EQ(seen, expected);
  EXPECT_EQ(iterations.SerializeAsString(), client_->Iterations(name).SerializeAsString());
}

// As a browser does: the address stays, Last-Event-ID tells where it was.
TEST_F(RestStreamTest, ReconnectsSeeEachEventOnce) {
  const std::string name = client_->Create(400);
  std::string last_event_id;
  std::vector<std::int64_t> seqs;
  int connections = 0;
  while (true) {
    ++connections;
    const std::string header = last_event_id.empty() ? "" : "Last-Event-ID: " + last_event_id + "\r\n";
    EventStream stream(http_->address(), Target(name, 0), true, header);
    if (stream.head().code == 204) break;  // a browser stops here
    ASSERT_EQ(stream.head().code, 200);
    StreamEvent event;
    for (int read = 0; read < 1 + connections * 7 && stream.Read(&event); ++read) {
      last_event_id = event.id;
      if (event.kind != "snapshot") seqs.push_back(SeqOf(event.json));
    }
  }
  EXPECT_GT(connections, 5);
  ASSERT_EQ(seqs.size(), 403u);
  for (std::size_t i = 0; i < seqs.size(); ++i) ASSERT_EQ(seqs[i], static_cast<std::int64_t>(i) + 1);
}

TEST_F(RestStreamTest, WhatCannotBeWatchedIsRefusedAsAnyRequest) {
  const std::string name = client_->Create(2);
  client_->WaitForEnd(name);
  HttpClient client(http_->address());
  EXPECT_EQ(client.Get("/v1/jobs/none:watch").code, 404);
  EXPECT_EQ(HttpClient(http_->address()).Get(Target(name, 99)).code, 400);
  EXPECT_EQ(HttpClient(http_->address()).Get("/v1/" + name + ":watch?delivery=SOMETIMES").code, 400);
  const HttpClient::Reply reply = HttpClient(http_->address()).Get(Target(name), "Last-Event-ID: x\r\n");
  EXPECT_EQ(reply.code, 400);
  EXPECT_THAT(reply.body, HasSubstr("resume_after_seq: must be an integer"));
  EXPECT_EQ(HttpClient(http_->address()).Call("HEAD", Target(name)).code, 200);
}

TEST_F(RestStreamTest, OldClientsGetLinesUntilTheEnd) {
  const std::string name = client_->Create(2);
  client_->WaitForEnd(name);
  HttpClient client(http_->address());
  client.Send("GET " + Target(name) + " HTTP/1.0\r\n\r\n");
  const HttpClient::Reply head = client.ReadHead();
  EXPECT_EQ(head.code, 200);
  EXPECT_FALSE(head.headers.contains("transfer-encoding"));
  EXPECT_EQ(head.headers.at("content-type"), "application/x-ndjson");
}

TEST_F(RestStreamTest, AStreamWithoutEventsBeats) {
  http_.reset();
  Start({.heartbeat = std::chrono::milliseconds(10)});
  StoreJob(engine_.store(), "manual", SpecOf(SmallScenario()));
  EventStream stream = Open("jobs/manual", true);
  StreamEvent event;
  ASSERT_TRUE(stream.Read(&event));
  ASSERT_TRUE(stream.Read(&event));  // event 1
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  engine_.store().ChangeState(
      "manual", 2, {.state = JobState::kCancelled, .time_us = NowUs(), .message = {}, .report = {}},
      [&](const absl::Status&) {
        engine_.hub().Publish("manual", {.seq = 2, .what = StateChange{.state = JobState::kCancelled}});
      });
  ASSERT_TRUE(stream.Read(&event));
  EXPECT_EQ(event.id, "2");
  EXPECT_GE(stream.comments(), 1);
  EXPECT_FALSE(stream.Read(&event));
  EXPECT_TRUE(stream.ended_well());
}

TEST_F(RestStreamTest, ADrainEndsStreamsWithTheReason) {
  const std::string name = client_->Create(SearchOptions::kMaxIterations);
  client_->WaitForIterations(name, 3);
  EventStream sse = Open(name, true);
  EventStream lines = Open(name, false);
  std::thread drain([&] { http_->Shutdown(std::chrono::seconds(5)); });
  for (EventStream* stream : {&sse, &lines}) {
    const auto events = stream->ReadAll();
    ASSERT_GE(events.size(), 2u);
    EXPECT_THAT(events.back().json, HasSubstr(R"("status":"UNAVAILABLE")"));
    EXPECT_TRUE(stream->ended_well());
    for (std::size_t i = 1; i + 1 < events.size(); ++i) {
      EXPECT_EQ(SeqOf(events[i].json), static_cast<std::int64_t>(i));
    }
  }
  drain.join();
}

TEST_F(RestStreamTest, AWatcherThatStopsReadingIsCutOffAndHarmsNobody) {
  http_.reset();
  Start({.stall_time = std::chrono::milliseconds(300)});
  const std::string name = client_->Create(20'000);
  EventStream stalled(http_->address(), Target(name), false, "", 4096);
  StreamEvent event;
  ASSERT_TRUE(stalled.Read(&event));
  const std::vector<std::string> events = OverHttp(name, true, 0);  // to the job's end
  EXPECT_EQ(events.size(), 20'004u);
  for (int i = 0; i < 2000 && log().empty(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_THAT(log(), HasSubstr("cut off 127.0.0.1:"));
  EXPECT_THAT(log(), HasSubstr("at " + Target(name) + ": it did not take what it asked for within 300 ms"));
  // What it has is whole, up to where it was cut off.
  std::int64_t seq = 0;
  while (stalled.Read(&event)) ASSERT_EQ(SeqOf(event.json), ++seq);
  EXPECT_LT(seq, 20'003);
  EXPECT_FALSE(stalled.ended_well());
}

TEST_F(RestStreamTest, WatchersThatLeaveLeaveNothingBehind) {
  const std::string name = client_->Create(300);
  std::vector<std::thread> watchers;
  std::atomic<int> whole = 0;
  for (int i = 0; i < 60; ++i) {
    watchers.emplace_back([&, i] {
      EventStream stream = Open(name, i % 2 == 0);
      StreamEvent event;
      const int leaves_after = i % 3 == 0 ? i : 1'000'000;
      int read = 0;
      while (read < leaves_after && stream.Read(&event)) ++read;
      if (i % 3 != 0 && read == 304) ++whole;
    });
  }
  for (std::thread& watcher : watchers) watcher.join();
  EXPECT_EQ(whole, 40);
}

}  // namespace
}  // namespace orbitune::server_test
