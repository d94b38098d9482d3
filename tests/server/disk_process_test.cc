// The server and its disk: one that is full or locked for a while, backups taken and put back, damage, and what
// retention removes.
#include <gmock/gmock.h>
#include <grpc/grpc.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "google/rpc/error_details.pb.h"
#include "grpcpp/generic/generic_stub.h"
#include "orbitune/v1/gains.grpc.pb.h"
#include "storage/sqlite_connection.h"
#include "tests/server/engine_support.h"
#include "tests/server/process_support.h"
#include "tests/server/rest_support.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr int kLong = 3000;  // iterations: enough to be disturbed on their way

class DiskProcessTest : public ::testing::Test {
 protected:
  std::unique_ptr<Server> Start(std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"--data-dir", Data(), "--listen", "127.0.0.1:0", "--threads", "2"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return std::make_unique<Server>(NextPrefix(), arguments);
  }
  std::string Data() { return directory_.File("data"); }
  std::string Database() { return Data() + "/orbitune.db"; }
  std::string NextPrefix() { return directory_.File("process-" + std::to_string(++processes_)); }

  struct Result {
    int code;
    std::string text;
  };
  // Of orbituned, to its end.
  Result Run(std::vector<std::string> arguments) {
    Process process(NextPrefix(), ServerCommand(arguments));
    const int code = process.Wait();
    return {code, process.out() + process.err()};
  }

  // Polls; fails the test where it takes minutes.
  static void Await(const std::function<bool()>& condition) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(2);
    while (!condition()) {
      ASSERT_LT(std::chrono::steady_clock::now(), deadline);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  static HttpClient::Reply Ready(const Server& server) { return HttpClient(server.http_address()).Get("/readyz"); }

  // What grpc.health.v1 says of the server: 1 SERVING, 2 NOT_SERVING.
  static int Health(Client& client) {
    grpc::GenericStub stub(client.channel());
    grpc::ClientContext context;
    grpc::CompletionQueue queue;
    const grpc::Slice nothing;
    const grpc::ByteBuffer request(&nothing, 1);
    const auto call = stub.PrepareUnaryCall(&context, "/grpc.health.v1.Health/Check", request, &queue);
    call->StartCall();
    grpc::ByteBuffer response;
    grpc::Status status;
    call->Finish(&response, &status, nullptr);
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
    EXPECT_TRUE(status.ok()) << status.error_message();
    grpc::Slice bytes;
    (void)response.DumpToSingleSlice(&bytes);
    return bytes.size() == 2 ? bytes.begin()[1] : 0;  // field 1, a varint
  }

  // A job whose disk fails on the way: it waits, all is told, and it ends as if nothing had been.
  void ExpectToOutlast(const std::function<void(Server&)>& harm, const std::function<void(Server&)>& heal,
                       const std::string& reason) {
    const auto server = Start();
    Client client(server->address());
    v1::CreateJobRequest request = CreateRequest(kLong);
    request.mutable_job()->mutable_hyperparameters()->set_directions(16);
    v1::Job created;
    ASSERT_TRUE(client.Create(request, &created).ok());
    client.WaitForIterations(created.name(), 20);
    harm(*server);
    Await([&] { return Ready(*server).code == 503; });
    EXPECT_THAT(Ready(*server).body, AllOf(HasSubstr("UNAVAILABLE"), HasSubstr("orbitune.db"), HasSubstr(reason)));
    EXPECT_EQ(HttpClient(server->http_address()).Get("/healthz").code, 200);
    Await([&] { return Health(client) == 2; });
    const grpc::Status refused = client.Create(request);
    EXPECT_EQ(refused.error_code(), grpc::StatusCode::UNAVAILABLE);
    EXPECT_THAT(refused.error_message(), HasSubstr(reason));
    EXPECT_TRUE(DetailsOf(refused).retry);
    EXPECT_EQ(client.Cancel(created.name()).error_code(), grpc::StatusCode::UNAVAILABLE);
    // It is read, and stands still.
    const v1::Job waiting = client.Get(created.name());
    EXPECT_EQ(waiting.state(), v1::JOB_STATE_RUNNING);
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    EXPECT_EQ(client.Get(created.name()).completed_iterations(), waiting.completed_iterations());
    EXPECT_LT(waiting.completed_iterations(), kLong);

    heal(*server);
    Await([&] { return Ready(*server).code == 200 && Health(client) == 1; });
    v1::Job again;
    ASSERT_TRUE(client.Create(request, &again).ok());
    EXPECT_EQ(client.WaitForEnd(created.name()).state(), v1::JOB_STATE_SUCCEEDED);
    EXPECT_EQ(client.WaitForEnd(again.name()).state(), v1::JOB_STATE_SUCCEEDED);
    EXPECT_TRUE(client.Iterations(created.name()).SerializeAsString() ==
                client.Iterations(again.name()).SerializeAsString());
    EXPECT_THAT(server->process().err(), AllOf(HasSubstr(reason), HasSubstr("the disk is back")));
  }

  TemporaryDirectory directory_;

 private:
  int processes_ = 0;
};

// Files that cannot grow any more are what a full disk looks like; the server's output is shorter than that.
void LimitFiles(Server& server, rlim_t bytes) {
  rlimit limit{};
  ASSERT_EQ(prlimit(server.process().pid(), RLIMIT_FSIZE, nullptr, &limit), 0);
  limit.rlim_cur = std::min(bytes, limit.rlim_max);
  ASSERT_EQ(prlimit(server.process().pid(), RLIMIT_FSIZE, &limit, nullptr), 0);
}

TEST_F(DiskProcessTest, AJobOutlastsADiskThatIsFullForAWhile) {
  ExpectToOutlast([](Server& server) { LimitFiles(server, 4096); },
                  [](Server& server) { LimitFiles(server, RLIM_INFINITY); }, "disk");
}

TEST_F(DiskProcessTest, AJobOutlastsALockThatIsHeldForAWhile) {
  std::unique_ptr<Connection> other;
  ExpectToOutlast(
      [&](Server&) {
        other = *Connection::Open(Database(), Connection::Mode::kReadWrite);
        // Between two commits of the writer, which is quick to come again.
        ASSERT_TRUE(other->Execute("PRAGMA busy_timeout = 0").ok());
        const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(2);
        while (!other->Execute("BEGIN IMMEDIATE").ok() && std::chrono::steady_clock::now() < deadline) {
        }
      },
      [&](Server&) { EXPECT_TRUE(other->Execute("COMMIT").ok()); }, "locked");
}

TEST_F(DiskProcessTest, ABackupIsTakenFromAServerAtWorkAndPutBack) {
  const std::string backup = directory_.File("backup.db");
  std::string name;
  int in_backup = 0;
  {
    const auto server = Start();
    Client client(server->address());
    const std::string finished = client.Create(5);
    client.WaitForEnd(finished);
    name = client.Create(SearchOptions::kMaxIterations);
    client.WaitForIterations(name, 50);
    const int before = client.Get(name).completed_iterations();
    const Result taken = Run({"backup", backup, "--data-dir", Data()});
    EXPECT_EQ(taken.code, 0) << taken.text;
    EXPECT_THAT(taken.text, AllOf(HasSubstr(backup), HasSubstr("2 jobs (1 unfinished)")));
    const Result twice = Run({"backup", backup, "--data-dir", Data()});
    EXPECT_EQ(twice.code, 1);
    EXPECT_THAT(twice.text, HasSubstr("is there already"));
    const Result checked = Run({"check", "--data-dir", Data()});
    EXPECT_EQ(checked.code, 0) << checked.text;
    EXPECT_THAT(checked.text, HasSubstr("no fault found"));
    const Result refused = Run({"restore", backup, "--data-dir", Data()});
    EXPECT_EQ(refused.code, 1);
    EXPECT_THAT(refused.text, HasSubstr("another server"));
    client.WaitForIterations(name, before + 50);
    ASSERT_TRUE(client.Delete(finished).ok());
    server->KillHard();
  }
  const Result restored = Run({"restore", backup, "--data-dir", Data()});
  EXPECT_EQ(restored.code, 0) << restored.text;
  EXPECT_THAT(restored.text, AllOf(HasSubstr("2 jobs"), HasSubstr("orbitune-replaced-")));
  const Result checked = Run({"check", backup});
  EXPECT_EQ(checked.code, 0) << checked.text;
  // The job goes on from where the backup has it.
  const auto server = Start();
  Client client(server->address());
  in_backup = client.Get(name).completed_iterations();
  EXPECT_GE(in_backup, 50);
  client.WaitForIterations(name, in_backup + 10);
  EXPECT_TRUE(client.Cancel(name).ok());
}

TEST_F(DiskProcessTest, ADamagedDatabaseIsRefusedAndABackupHelps) {
  const std::string backup = directory_.File("backup.db");
  {
    const auto server = Start();
    Client client(server->address());
    client.WaitForEnd(client.Create(400));
    EXPECT_EQ(server->Terminate(), 0);
  }
  ASSERT_EQ(Run({"backup", directory_.File(""), "--data-dir", Data()}).code, 0);
  ASSERT_EQ(Run({"backup", backup, "--data-dir", Data()}).code, 0);
  {
    std::fstream file(Database(), std::ios::in | std::ios::out | std::ios::binary);
    file.write(std::string(8192, 'x').data(), 8192);
  }
  const Result refused = Run({"--data-dir", Data(), "--listen", "127.0.0.1:0"});
  EXPECT_EQ(refused.code, 1);
  EXPECT_THAT(refused.text, AllOf(HasSubstr(Database()), HasSubstr("orbituned restore")));
  EXPECT_EQ(Run({"check", "--data-dir", Data()}).code, 1);
  EXPECT_EQ(Run({"backup", directory_.File("of-damaged.db"), "--data-dir", Data()}).code, 1);
  EXPECT_FALSE(std::filesystem::exists(directory_.File("of-damaged.db")));
  const Result restored = Run({"restore", backup, "--data-dir", Data()});
  EXPECT_EQ(restored.code, 0) << restored.text;
  EXPECT_EQ(Start()->Terminate(), 0);
}

TEST_F(DiskProcessTest, TheCommandsTellBadUsage) {
  EXPECT_EQ(Run({"backup"}).code, 2);
  EXPECT_EQ(Run({"restore"}).code, 2);
  EXPECT_EQ(Run({"check", "--no-such-flag"}).code, 2);
  const Result none = Run({"check", "--data-dir", directory_.File("none")});
  EXPECT_EQ(none.code, 1);
  EXPECT_THAT(none.text, HasSubstr("there is no database"));
  EXPECT_EQ(Run({"--retain-jobs-days", "-1"}).code, 2);
  EXPECT_THAT(Run({"--max-database-bytes", "many"}).text, HasSubstr("--max-database-bytes"));
  EXPECT_THAT(Run({"--help"}).text, AllOf(HasSubstr("backup"), HasSubstr("restore"), HasSubstr("check")));
}

TEST_F(DiskProcessTest, RetentionRemovesWhatIsOldAndTheApiSaysSo) {
  const std::string at_once = "0.0000001";  // days
  std::string name;
  v1::Job before;
  {
    const auto server = Start();
    Client client(server->address());
    name = client.Create(200);
    before = client.WaitForEnd(name);
    EXPECT_EQ(server->Terminate(), 0);
  }
  {
    const auto server = Start({"--retain-iterations-days", at_once});
    Client client(server->address());
    Await([&] { return client.Get(name).has_iterations_removed_time(); });
    v1::Job after = client.Get(name);
    after.clear_iterations_removed_time();
    EXPECT_EQ(after.SerializeAsString(), before.SerializeAsString());
    v1::ListIterationsRequest request;
    request.set_parent(name);
    for (const int max_points : {0, 100}) {
      request.set_max_points(max_points);
      v1::ListIterationsResponse response;
      grpc::ClientContext context;
      const grpc::Status status = client.tuning().ListIterations(&context, request, &response);
      EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
      EXPECT_EQ(DetailsOf(status).reason, "ITERATIONS_REMOVED");
    }
    // A watcher hears what is left, and of what is not.
    grpc::Status status;
    Watch watch(client, name);
    std::int64_t seq = 0;
    int gaps = 0;
    for (const v1::WatchJobResponse& event : watch.ReadAll(&status)) {
      if (event.has_snapshot()) continue;
      EXPECT_EQ(event.has_gap() ? event.gap().first_seq() : event.seq(), seq + 1) << event.ShortDebugString();
      gaps += event.has_gap() ? 1 : 0;
      seq = event.seq();
    }
    EXPECT_TRUE(status.ok()) << status.error_message();
    EXPECT_EQ(seq, before.last_seq());
    EXPECT_GE(gaps, 1);
    EXPECT_THAT(server->process().err(), HasSubstr("retention: removed the iterations of jobs " + name.substr(5)));
    EXPECT_EQ(server->Terminate(), 0);
  }
  const auto server = Start({"--retain-jobs-days", at_once});
  Client client(server->address());
  v1::Job gone;
  Await([&] { return client.Get(name, &gone).error_code() == grpc::StatusCode::NOT_FOUND; });
  v1::GetGainSetRequest request;
  request.set_name("gainSets/" + name.substr(5));
  v1::GainSet set;
  grpc::ClientContext context;
  EXPECT_TRUE(v1::GainService::NewStub(client.channel())->GetGainSet(&context, request, &set).ok());
}

}  // namespace
}  // namespace orbitune::server_test
