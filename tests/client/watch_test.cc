#include <gtest/gtest.h>

#include <csignal>
#include <sstream>
#include <thread>

#include "client/cli/watch_stream.h"
#include "google/protobuf/util/json_util.h"
#include "tests/client/fake_server.h"

namespace orbitune::cli {
namespace {

constexpr int kIterations = 9;  // of seq 2..10; 1: RUNNING, 11: the end
constexpr std::int64_t kEndSeq = kIterations + 2;
const grpc::Status kUnavailable(grpc::StatusCode::UNAVAILABLE, "draining");

v1::WatchJobResponse Snapshot(std::int64_t seq, v1::JobState state = v1::JOB_STATE_RUNNING) {
  v1::WatchJobResponse message;
  message.set_seq(seq);
  v1::Job& job = *message.mutable_snapshot();
  job.set_name("jobs/a");
  job.set_scenario("scenarios/gto-geo");
  job.set_state(state);
  job.mutable_hyperparameters()->set_iterations(kIterations);
  return message;
}

v1::WatchJobResponse StateEvent(std::int64_t seq, v1::JobState state) {
  v1::WatchJobResponse message;
  message.set_seq(seq);
  message.mutable_state_change()->set_state(state);
  return message;
}

v1::WatchJobResponse Event(std::int64_t seq, v1::JobState end = v1::JOB_STATE_SUCCEEDED) {
  if (seq == 1) return StateEvent(seq, v1::JOB_STATE_RUNNING);
  if (seq == kEndSeq) return StateEvent(seq, end);
  v1::WatchJobResponse message;
  message.set_seq(seq);
  v1::Iteration& iteration = *message.mutable_iteration();
  iteration.set_iteration(static_cast<int>(seq) - 1);
  iteration.set_cost(1000.0 / static_cast<double>(seq));
  iteration.set_outcome(v1::OUTCOME_SETTLED);
  return message;
}

// A snapshot before any event, events first..last, and the status.
FakeServer::WatchScript Play(std::int64_t first, std::int64_t last, const grpc::Status& status) {
  return [=](grpc::ServerContext*, FakeServer::WatchWriter* writer) {
    writer->Write(Snapshot(first - 1));
    for (std::int64_t seq = first; seq <= last; ++seq) writer->Write(Event(seq));
    return status;
  };
}

// The iterations of events first..last in one message.
v1::WatchJobResponse Together(std::int64_t first, std::int64_t last) {
  v1::WatchJobResponse message;
  message.set_seq(last);
  for (std::int64_t seq = first; seq <= last; ++seq) {
    *message.mutable_iteration_batch()->add_iterations() = Event(seq).iteration();
  }
  return message;
}

std::vector<std::int64_t> EventSeqs(const std::string& json_lines) {
  std::vector<std::int64_t> seqs;
  std::istringstream lines(json_lines);
  for (std::string line; std::getline(lines, line);) {
    v1::WatchJobResponse message;
    EXPECT_TRUE(google::protobuf::util::JsonStringToMessage(line, &message).ok()) << line;
    if (!message.has_snapshot()) seqs.push_back(message.seq());
  }
  return seqs;
}

TEST(Watch, ReconnectsWithoutGapOrDouble) {
  FakeServer server;
  server.watches = {Play(1, 4, kUnavailable),      // a drain
                    Play(3, 7, grpc::Status::OK),  // repeats events, and ends too soon
                    [](grpc::ServerContext*, FakeServer::WatchWriter*) { return kUnavailable; },
                    [](grpc::ServerContext* context, FakeServer::WatchWriter* writer) {
                      writer->Write(Snapshot(8));
                      writer->Write(Event(8));
                      context->TryCancel();
                      return grpc::Status::CANCELLED;
                    },
                    // The snapshot is ahead of what has been seen, and is no event.
                    [](grpc::ServerContext*, FakeServer::WatchWriter* writer) {
                      writer->Write(Snapshot(kEndSeq));
                      return kUnavailable;
                    },
                    Play(8, kEndSeq, grpc::Status::OK)};
  const FakeServer::Result result = server.Run({"--json", "watch", "a"});
  EXPECT_EQ(result.code, 0) << result.err;
  const std::vector<std::int64_t> expected = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
  EXPECT_EQ(EventSeqs(result.out), expected);
  EXPECT_NE(result.err.find("connection lost (UNAVAILABLE: draining)"), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("connected again"), std::string::npos);
  std::vector<std::int64_t> resumed;
  for (const auto& request : server.watch_requests) resumed.push_back(request.resume_after_seq());
  const bool saw_8 = resumed.size() == 6 && resumed[4] == 8;  // a cancelled call may lose what it had sent
  EXPECT_EQ(resumed, (std::vector<std::int64_t>{0, 4, 7, 7, saw_8 ? 8 : 7, saw_8 ? 8 : 7}));
  EXPECT_EQ(server.watch_requests[0].name(), "jobs/a");
  EXPECT_EQ(server.watch_requests[0].delivery(), v1::DELIVERY_EVERY);
}

TEST(Watch, IterationsThatComeTogetherAreToldOneByOne) {
  FakeServer server;
  server.watches = {Play(1, kEndSeq, grpc::Status::OK),
                    [](grpc::ServerContext*, FakeServer::WatchWriter* writer) {
                      writer->Write(Snapshot(0));
                      writer->Write(Event(1));
                      writer->Write(Together(2, 5));
                      return kUnavailable;
                    },
                    [](grpc::ServerContext*, FakeServer::WatchWriter* writer) {
                      writer->Write(Snapshot(0));
                      writer->Write(Together(4, 8));  // two of them again
                      writer->Write(Together(9, kEndSeq - 1));
                      writer->Write(Event(kEndSeq));
                      return grpc::Status::OK;
                    }};
  const FakeServer::Result alone = server.Run({"--json", "watch", "a"});
  const FakeServer::Result together = server.Run({"--json", "watch", "a"});
  EXPECT_EQ(together.code, 0) << together.err;
  EXPECT_EQ(together.out, alone.out);
  EXPECT_GT(server.watch_requests[1].max_iterations_per_message(), 1);
  EXPECT_EQ(server.watch_requests[2].resume_after_seq(), 5);
}

TEST(Watch, FromOnlyNewEventsResumesAfterTheSnapshot) {
  FakeServer server;
  server.watches = {Play(5, 4, kUnavailable), Play(5, kEndSeq, grpc::Status::OK)};
  EXPECT_EQ(server.Run({"watch", "a", "--from", "-1"}).code, 0);
  EXPECT_EQ(server.watch_requests[0].resume_after_seq(), -1);
  EXPECT_EQ(server.watch_requests[1].resume_after_seq(), 4);
}

TEST(Watch, GivesUp) {
  FakeServer server;
  server.watches = {Play(1, 4, kUnavailable)};
  FakeServer::Result result = server.Run({"watch", "a", "--reconnect-seconds", "0"});
  EXPECT_EQ(result.code, 4);
  EXPECT_NE(result.err.find("orbitune: UNAVAILABLE: draining"), std::string::npos) << result.err;
  server.watches = {Play(1, 4, {grpc::StatusCode::NOT_FOUND, "deleted"})};  // no loss of the transport
  EXPECT_EQ(server.Run({"watch", "a"}).code, 3);
  EXPECT_EQ(RunClient({"--server", "127.0.0.1:1", "watch", "a"}).code, 4);  // never connected
}

TEST(Watch, PlainLines) {
  FakeServer server;
  server.watches = {Play(1, kEndSeq, grpc::Status::OK)};
  const FakeServer::Result result = server.Run({"watch", "jobs/a"});
  EXPECT_EQ(result.out.rfind("jobs/a  RUNNING  scenarios/gto-geo  0/9 iterations\n"
                             "state RUNNING\n"
                             "iteration 1/9  J 500  reduction 0.0 %  K 0 0 0 0 0\n"
                             "iteration 2/9  J 333.333  reduction 33.3 %  K 0 0 0 0 0\n",
                             0),
            0u)
      << result.out;
  EXPECT_NE(result.out.find("\nstate SUCCEEDED\njobs/a  SUCCEEDED\n9/9 iterations"), std::string::npos) << result.out;
}

TEST(Watch, ExitCodeTellsHowTheJobEnded) {
  for (const v1::JobState state : {v1::JOB_STATE_FAILED, v1::JOB_STATE_CANCELLED}) {
    FakeServer server;
    server.watches = {[state](grpc::ServerContext*, FakeServer::WatchWriter* writer) {
      v1::WatchJobResponse end = Event(kEndSeq, state);
      if (state == v1::JOB_STATE_FAILED) end.mutable_state_change()->set_message("no pair is left");
      writer->Write(Snapshot(kEndSeq - 1));
      writer->Write(end);
      return grpc::Status::OK;
    }};
    const FakeServer::Result result = server.Run({"watch", "a", "--from", "10"});
    EXPECT_EQ(result.code, 1);
    EXPECT_EQ(result.out.find("error: no pair is left") != std::string::npos, state == v1::JOB_STATE_FAILED);
  }
}

TEST(Watch, PauseIsToldAndWaitedFor) {
  FakeServer server;
  server.watches = {[](grpc::ServerContext*, FakeServer::WatchWriter* writer) {
    writer->Write(Snapshot(2, v1::JOB_STATE_PAUSED));
    writer->Write(StateEvent(1, v1::JOB_STATE_PAUSED));  // history: not told again
    writer->Write(StateEvent(2, v1::JOB_STATE_PAUSED));
    writer->Write(StateEvent(3, v1::JOB_STATE_RUNNING));
    writer->Write(Event(kEndSeq));
    return grpc::Status::OK;
  }};
  const FakeServer::Result result = server.Run({"watch", "a"});
  EXPECT_EQ(result.code, 0);
  const std::size_t told = result.err.find("jobs/a is paused");
  EXPECT_NE(told, std::string::npos);
  EXPECT_EQ(result.err.find("jobs/a is paused", told + 1), std::string::npos) << result.err;
}

TEST(Watch, InterruptLeavesTheJobAndTellsHowToGoOn) {
  FakeServer server;
  std::atomic<bool> cancelled = false;
  server.watches = {[&](grpc::ServerContext* context, FakeServer::WatchWriter* writer) {
    writer->Write(Snapshot(4));
    writer->Write(Event(1));
    std::this_thread::sleep_for(std::chrono::milliseconds(100));  // most likely read by then
    kill(getpid(), SIGINT);
    for (int i = 0; i < 1000 && !context->IsCancelled(); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    cancelled = context->IsCancelled();
    return kUnavailable;
  }};
  const FakeServer::Result result = server.Run({"watch", "a"});
  EXPECT_EQ(result.code, 130);
  EXPECT_NE(result.err.find("watch jobs/a"), std::string::npos) << result.err;
  EXPECT_EQ(result.err.find("connection lost"), std::string::npos) << result.err;
}

TEST(Watch, TerminalShowsOneLineOfTheLatest) {
  FakeServer server;
  server.watches = {Play(1, kEndSeq, grpc::Status::OK)};
  const FakeServer::Result result = server.Run({"watch", "a"}, 50);
  EXPECT_EQ(result.code, 0);
  EXPECT_EQ(server.watch_requests[0].delivery(), v1::DELIVERY_LATEST);
  EXPECT_EQ(server.watch_requests[0].resume_after_seq(), -1);
  EXPECT_EQ(result.out.rfind("\r\x1b[K", 0), 0u);
  EXPECT_EQ(result.out.find("iteration 1/"), std::string::npos);
  server.watches = {Play(1, kEndSeq, grpc::Status::OK)};
  EXPECT_NE(server.Run({"watch", "a", "--every"}, 50).out.find("iteration 1/9"), std::string::npos);
}

}  // namespace
}  // namespace orbitune::cli
