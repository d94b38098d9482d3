// The binaries as a user runs them: orbituned in its own process, stopped, killed and started again, and orbitune
// against it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <thread>

#include "core/simd/lane_kernel.h"
#include "orbitune/v1/campaign.grpc.pb.h"
#include "storage/sqlite_connection.h"
#include "tests/server/engine_support.h"
#include "tests/server/process_support.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::HasSubstr;
using ::testing::MatchesRegex;
using ::testing::StartsWith;

class ProcessTest : public ::testing::Test {
 protected:
  // On a data directory of its own, that stays when the server goes.
  std::unique_ptr<Server> Start(const std::string& data, const std::string& threads = "2") {
    return std::make_unique<Server>(
        NextPrefix(),
        std::vector<std::string>{"--data-dir", directory_.File(data), "--listen", "127.0.0.1:0", "--threads", threads});
  }

  struct Result {
    int code;
    std::string out;
    std::string err;
  };
  // Runs a command to its end.
  Result Run(const std::vector<std::string>& command, const std::vector<std::string>& environment = {}) {
    Process process(NextPrefix(), command, environment);
    const int code = process.Wait();
    return {code, process.out(), process.err()};
  }
  Result RunServer(const std::vector<std::string>& arguments, const std::vector<std::string>& environment = {}) {
    return Run(ServerCommand(arguments), environment);
  }
  Result RunCli(const Server& server, const std::vector<std::string>& arguments) {
    std::vector<std::string> command = {ORBITUNE_CLI, "--server", server.address()};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return Run(command);
  }

  std::string NextPrefix() { return directory_.File("process-" + std::to_string(++processes_)); }
  std::string File(const std::string& name) { return directory_.File(name); }

  TemporaryDirectory directory_;

 private:
  int processes_ = 0;
};

// What must be the same however a job was run.
struct Outcome {
  std::string iterations;
  std::string report;
  std::string digest;
};

Outcome OutcomeOf(Client& client, const std::string& name) {
  const v1::Job job = client.WaitForEnd(name);
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error_message();
  EXPECT_TRUE(job.has_report());
  return {client.Iterations(name).SerializeAsString(), job.report().SerializeAsString(), job.provenance().digest()};
}

// Long enough to be killed on its way.
constexpr int kLonger = 4000;

v1::CreateJobRequest LongerRequest() {
  v1::CreateJobRequest request = CreateRequest(kLonger);
  request.mutable_job()->mutable_hyperparameters()->set_directions(16);
  return request;
}

std::string CreateLonger(Client& client) {
  v1::Job job;
  const grpc::Status status = client.Create(LongerRequest(), &job);
  EXPECT_TRUE(status.ok()) << status.error_message();
  return job.name();
}

TEST_F(ProcessTest, ThreadsKillsAndRestartsDoNotShow) {
  Outcome one;
  Outcome two;
  {
    const auto server = Start("one", "1");
    Client client(server->address());
    one = OutcomeOf(client, CreateLonger(client));
  }
  {
    const auto server = Start("two", "2");
    Client client(server->address());
    two = OutcomeOf(client, CreateLonger(client));
  }
  std::string name;
  for (const int kill_at : {5, 700, 1500}) {
    const auto server = Start("killed", kill_at == 700 ? "1" : "2");
    Client client(server->address());
    if (name.empty()) name = CreateLonger(client);
    client.WaitForIterations(name, kill_at);
    server->KillHard();
  }
  const auto server = Start("killed");
  Client client(server->address());
  const v1::Job taken_up = client.Get(name);
  EXPECT_GE(taken_up.completed_iterations(), 1500);
  const Outcome killed = OutcomeOf(client, name);
  EXPECT_GT(one.iterations.size(), kLonger * 50u);
  EXPECT_TRUE(two.iterations == one.iterations);
  EXPECT_TRUE(killed.iterations == one.iterations);
  EXPECT_TRUE(two.report == one.report);
  EXPECT_TRUE(killed.report == one.report);
  EXPECT_EQ(one.digest.size(), 64u);
  EXPECT_EQ(two.digest, one.digest);
  EXPECT_EQ(killed.digest, one.digest);
  EXPECT_EQ(RunCli(*server, {"verify", name, "--from", "1400", "--to", "1600"}).code, 0);
}

// Of the instruction sets that this processor has and that fuse multiplication and addition.
TEST_F(ProcessTest, InstructionSetsDoNotShowInTheDigest) {
  std::vector<std::string> digests;
  for (const std::string& target : simd::SupportedTargets()) {
    if (target == "baseline") continue;
    const Server server(NextPrefix(), {"--data-dir", File(target), "--listen", "127.0.0.1:0", "--simd", target});
    Client client(server.address());
    const v1::Job job = client.WaitForEnd(client.Create(60));
    digests.push_back(job.provenance().digest());
    ASSERT_EQ(job.provenance().engines_size(), 1);
    EXPECT_EQ(job.provenance().engines(0).simd_target(), target);
    EXPECT_TRUE(job.provenance().engines(0).fused_multiply_add());
  }
  for (const std::string& digest : digests) EXPECT_EQ(digest, digests[0]);
}

TEST_F(ProcessTest, AJobThatWasKilledIsVerifiedAndAnAlteredRowIsFound) {
  std::string name;
  {
    const auto server = Start("data");
    Client client(server->address());
    name = client.Create(400);
    client.WaitForIterations(name, 20);
    server->KillHard();
  }
  {
    const auto server = Start("data");
    Client client(server->address());
    EXPECT_EQ(client.WaitForEnd(name).state(), v1::JOB_STATE_SUCCEEDED);
    const Result verified = RunCli(*server, {"verify", name});
    EXPECT_EQ(verified.code, 0) << verified.out << verified.err;
    EXPECT_THAT(verified.out, HasSubstr("IDENTICAL\niterations 1 to 400 come out the same, bit for bit"));
    EXPECT_EQ(server->Terminate(), 0);
  }
  {
    auto database = Connection::Open(File("data") + "/orbitune.db", Connection::Mode::kReadWrite);
    ASSERT_TRUE(database.ok());
    ASSERT_TRUE((*database)->Execute("UPDATE iterations SET k3 = k3 + 1e-12 WHERE iteration = 321").ok());
  }
  const auto server = Start("data");
  const Result altered = RunCli(*server, {"verify", name});
  EXPECT_EQ(altered.code, 1) << altered.err;
  EXPECT_THAT(altered.out, HasSubstr("ALTERED\n"));
  EXPECT_THAT(altered.out, HasSubstr("the first that differs is iteration 321"));
  EXPECT_EQ(RunCli(*server, {"--json", "verify", name, "--to", "9"}).code, 1);
}

TEST_F(ProcessTest, SigtermKeepsAJobForTheNextStart) {
  std::string name;
  for (const int signal : {SIGTERM, SIGINT}) {
    const auto server = Start("data");
    Client client(server->address());
    if (name.empty()) name = client.Create(SearchOptions::kMaxIterations);
    const int before = client.Get(name).completed_iterations();
    client.WaitForIterations(name, before + 3);
    Watch watch(client, name, -1);
    v1::WatchJobResponse snapshot;
    ASSERT_TRUE(watch.Read(&snapshot));  // the server knows this watcher
    grpc::Status status;
    std::thread reader([&] { watch.ReadAll(&status); });
    EXPECT_EQ(server->Terminate(signal), 0);
    reader.join();
    EXPECT_THAT(server->process().out(), HasSubstr("unfinished jobs go on at the next start"));
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE) << status.error_message();
  }
  const auto server = Start("data");
  Client client(server->address());
  const v1::Job job = client.Get(name);
  EXPECT_EQ(job.state(), v1::JOB_STATE_RUNNING);
  client.WaitForIterations(name, job.completed_iterations() + 1);
  EXPECT_TRUE(client.Cancel(name).ok());
}

TEST_F(ProcessTest, AWatcherThatResumesSeesEachEventOnce) {
  std::string name;
  std::int64_t last_seq = 0;
  v1::ListIterationsResponse seen;
  // Killed after so many events of the watcher's, which may be behind.
  for (const std::int64_t kill_after : {20, 700, 1500, 0}) {
    const auto server = Start("data");
    Client client(server->address());
    if (name.empty()) name = CreateLonger(client);
    Watch watch(client, name, last_seq);
    v1::WatchJobResponse event;
    bool killed = false;
    while (watch.Read(&event)) {
      if (event.has_snapshot()) continue;
      ASSERT_EQ(event.seq(), ++last_seq);
      if (event.has_iteration()) *seen.add_iterations() = event.iteration();
      if (kill_after != 0 && last_seq >= kill_after && !killed) {
        server->KillHard();
        killed = true;
      }
    }
    const grpc::Status status = watch.Finish();
    EXPECT_EQ(status.ok(), kill_after == 0) << status.error_message();
    if (kill_after == 0) {
      EXPECT_EQ(event.state_change().state(), v1::JOB_STATE_SUCCEEDED);
      EXPECT_TRUE(seen.SerializeAsString() == client.Iterations(name).SerializeAsString());
      EXPECT_EQ(client.Get(name).last_seq(), last_seq);
    }
  }
}

// A campaign's members with all that came of them, less the names of its jobs.
std::string CampaignStory(v1::CampaignService::Stub& campaigns, Client& client, const std::string& name) {
  v1::ListCampaignMembersRequest request;
  request.set_parent(name);
  v1::ListCampaignMembersResponse members;
  grpc::ClientContext context;
  EXPECT_TRUE(campaigns.ListCampaignMembers(&context, request, &members).ok());
  std::string story;
  for (v1::CampaignMember& member : *members.mutable_members()) {
    if (!member.job().empty()) story += client.Iterations(member.job()).SerializeAsString();
    member.clear_job();
    story += member.SerializeAsString();
  }
  return story;
}

TEST_F(ProcessTest, KillsDoNotShowInACampaign) {
  std::vector<std::string> stories;
  std::vector<std::string> results;
  for (const std::vector<int>& kills : {std::vector<int>{}, {30, 900, 2500}}) {
    std::string name;
    std::int64_t seen = 0;
    for (std::size_t run = 0; run <= kills.size(); ++run) {
      const auto server = Start(kills.empty() ? "unbroken" : "killed");
      Client client(server->address());
      const auto campaigns = v1::CampaignService::NewStub(client.channel());
      if (name.empty()) {
        v1::CreateCampaignRequest request;
        v1::Campaign& campaign = *request.mutable_campaign();
        *campaign.mutable_scenario_definition() = SmallDefinition(600);
        campaign.mutable_initial_conditions()->mutable_draw()->set_count(6);
        campaign.mutable_held_out()->mutable_draw()->set_count(3);
        campaign.mutable_robust()->mutable_hyperparameters()->set_max_episodes(2000);
        v1::Campaign created;
        grpc::ClientContext context;
        const grpc::Status status = campaigns->CreateCampaign(&context, request, &created);
        ASSERT_TRUE(status.ok()) << status.error_message();
        name = created.name();
      }
      v1::WatchCampaignRequest watch;
      watch.set_name(name);
      watch.set_resume_after_seq(seen);
      grpc::ClientContext context;
      const auto reader = campaigns->WatchCampaign(&context, watch);
      v1::WatchCampaignResponse message;
      bool killed = false;
      while (reader->Read(&message)) {
        if (message.has_snapshot()) continue;
        if (!message.has_progress()) {
          ASSERT_EQ(message.seq(), ++seen);
        } else if (run < kills.size() && !killed && message.progress().tuned().completed_iterations() >= kills[run]) {
          server->KillHard();
          killed = true;
        }
      }
      const grpc::Status status = reader->Finish();
      if (killed) continue;
      ASSERT_TRUE(status.ok()) << status.error_message();
      ASSERT_EQ(message.state_change().state(), v1::CAMPAIGN_STATE_SUCCEEDED);
      results.push_back(message.state_change().results().SerializeAsString());
      stories.push_back(CampaignStory(*campaigns, client, name));
      break;
    }
  }
  ASSERT_EQ(stories.size(), 2u);
  EXPECT_TRUE(stories[0] == stories[1]);
  EXPECT_TRUE(results[0] == results[1]);
}

TEST_F(ProcessTest, ACampaignOnTheCommandLine) {
  const auto server = Start("data");
  const std::vector<std::string> create = {
      "campaign", "create",       "--scenario", "gto-geo",    "--count", "3",        "--seed",
      "7",        "--iterations", "20",         "--held-out", "2",       "--robust", "--robust-episodes",
      "300",      "--request-id", "mine"};
  std::vector<std::string> watched = create;
  watched.push_back("--watch");
  const Result made = RunCli(*server, watched);
  EXPECT_EQ(made.code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("initial condition 3/3  SUCCEEDED  J "));
  EXPECT_THAT(made.out, HasSubstr("robust tuning  SUCCEEDED"));
  EXPECT_THAT(made.out, HasSubstr("Reductions in % of the value under K(1), 2 held out initial conditions:"));
  EXPECT_THAT(made.out, HasSubstr("On the 2 held-out initial conditions "));
  const std::string name = made.out.substr(0, made.out.find(' '));

  EXPECT_THAT(RunCli(*server, create).out, StartsWith(name));  // the same request
  std::vector<std::string> other = create;
  other[5] = "4";
  EXPECT_EQ(RunCli(*server, other).code, 5);
  EXPECT_THAT(RunCli(*server, {"campaign", "list", "--state", "succeeded"}).out, HasSubstr(name));
  EXPECT_THAT(RunCli(*server, {"campaign", "show", name}).out, HasSubstr("drawn over Keplerian elements with seed 7"));
  EXPECT_EQ(LinesOf(RunCli(*server, {"campaign", "members", name}).out).size(), 7u);
  EXPECT_EQ(RunCli(*server, {"campaign", "pause", name}).code, 5);

  // What is exported can be tuned for again.
  EXPECT_EQ(RunCli(*server, {"campaign", "export", name, "-o", File("ics.csv")}).code, 0);
  const Result again = RunCli(*server, {"campaign", "create", "--scenario", "gto-geo", "--seed", "7", "--iterations",
                                        "20", "--ics", File("ics.csv"), "--watch", "--json"});
  EXPECT_EQ(again.code, 0) << again.err;
  const auto gains = [](const std::string& text) {
    const std::size_t at = text.find("\"mean_gains\"");
    return at == std::string::npos ? "none" : text.substr(at, text.find('}', at) - at);
  };
  EXPECT_EQ(gains(again.out), gains(RunCli(*server, {"campaign", "show", name, "--json"}).out));
  EXPECT_NE(gains(again.out), "none");

  EXPECT_EQ(RunCli(*server, {"report", name, "-o", File("campaign.html")}).code, 0);
  EXPECT_THAT(Contents(File("campaign.html")), HasSubstr("of 3 initial conditions: before (grey) and after"));
  const std::string members = RunCli(*server, {"campaign", "members", name, "--json"}).out;
  const std::string job = members.substr(members.find("jobs/"), 17);
  EXPECT_EQ(RunCli(*server, {"report", job, "-o", File("job.html")}).code, 0);
  EXPECT_THAT(Contents(File("job.html")), HasSubstr("The gains K over the iterations."));
  EXPECT_EQ(RunCli(*server, {"report", "campaigns/none", "-o", File("none.html")}).code, 3);
  EXPECT_EQ(RunCli(*server, {"report", "mine", "-o", File("none.html")}).code, 2);

  EXPECT_EQ(RunCli(*server, {"campaign", "extend", name, "--count", "1", "--watch"}).code, 0);
  EXPECT_THAT(RunCli(*server, {"campaign", "show", name}).out, HasSubstr("mean over 4"));
  EXPECT_EQ(RunCli(*server, {"campaign", "delete", name}).code, 0);
  EXPECT_EQ(RunCli(*server, {"campaign", "show", name}).code, 3);
}

TEST_F(ProcessTest, ASecondServerOnTheSameDataIsRefused) {
  const auto server = Start("data");
  const Result second = RunServer({"--data-dir", File("data"), "--listen", "127.0.0.1:0"});
  EXPECT_EQ(second.code, 1);
  EXPECT_THAT(second.err, HasSubstr("another server (process "));
  EXPECT_THAT(second.err, HasSubstr("use another data directory"));
  EXPECT_EQ(second.out, "");
  EXPECT_EQ(server->Terminate(), 0);
  Start("data");  // free again
}

TEST_F(ProcessTest, APortInUseIsTold) {
  const auto server = Start("data");
  const Result second = RunServer({"--data-dir", File("other"), "--listen", server->address()});
  EXPECT_EQ(second.code, 1);
  EXPECT_THAT(second.err, HasSubstr("cannot listen on \"" + server->address() + "\""));
  EXPECT_THAT(second.err, HasSubstr("in use"));
}

TEST_F(ProcessTest, ADataDirectoryThatCannotBeIsTold) {
  std::ofstream(File("file")) << "x";
  const Result result = RunServer({"--data-dir", File("file") + "/data", "--listen", "127.0.0.1:0"});
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.err, HasSubstr(File("file") + "/data"));
}

TEST_F(ProcessTest, WrongUsageIsExitStatus2) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"--frob"}, "--frob"},
      {{"extra"}, "extra"},
      {{"--threads", "-1"}, "--threads"},
      {{"--threads", "many"}, "many"},
      {{"--threads", "1000000"}, "1000000"},
      {{"--max-running-jobs", "0"}, "--max-running-jobs"},
      {{"--listen", "nowhere"}, "HOST:PORT"},
      {{"--listen", "127.0.0.1:70000"}, "[0, 65535]"},
      {{"--listen", ":"}, "HOST:PORT"},
      {{"--http", "nowhere"}, "HOST:PORT"},
      {{"--http-cors-origin", "example.org"}, "SCHEME://HOST"},
      {{"--http-max-connections", "0"}, "--http-max-connections"},
      {{"--retain-audit-days", "0.5"}, "--retain-audit-days"},
      {{"--config", File("none.toml")}, "none.toml"},
      {{"--data-dir"}, "--data-dir"}};
  for (const auto& [arguments, expected] : cases) {
    const Result result = RunServer(arguments);
    EXPECT_EQ(result.code, 2) << testing::PrintToString(arguments);
    EXPECT_THAT(result.err, HasSubstr(expected));
    EXPECT_EQ(result.out, "");
  }
}

TEST_F(ProcessTest, HelpTellsAll) {
  const Result help = RunServer({"--help"});
  EXPECT_EQ(help.code, 0);
  for (const char* part :
       {"--data-dir", "--listen", "--http", "--web-dir", "--http-cors-origin", "--threads", "--max-running-jobs",
        "--config", "--version", "ORBITUNE_DATA_DIR", "ORBITUNE_LISTEN", "ORBITUNE_HTTP", "ORBITUNE_THREADS",
        "ORBITUNE_MAX_RUNNING_JOBS", "ORBITUNE_CONFIG", "127.0.0.1:7313", "Exit status"}) {
    EXPECT_THAT(help.out, HasSubstr(part));
  }
  EXPECT_THAT(RunServer({"--version"}).out, StartsWith("orbituned "));
}

TEST_F(ProcessTest, FlagsBeatTheEnvironmentWhichBeatsTheFile) {
  const std::string file = File("orbituned.toml");
  std::ofstream(file) << "listen = \"127.0.0.1:0\"\nthreads = 3\nmax-running-jobs = 5\ndata-dir = \"" << File("file")
                      << "\"\n";
  const std::string config = "ORBITUNE_CONFIG=" + file;
  const auto started_with = [&](const std::vector<std::string>& arguments,
                                const std::vector<std::string>& environment) {
    Server server(NextPrefix(), arguments, environment);
    return server.process().out();
  };
  EXPECT_THAT(started_with({"--config", file}, {}), HasSubstr("data " + File("file") + "/orbitune.db\nthreads 3"));
  EXPECT_THAT(started_with({}, {config}), HasSubstr("data " + File("file") + "/orbitune.db\nthreads 3"));
  EXPECT_THAT(started_with({}, {config, "ORBITUNE_THREADS=4", "ORBITUNE_DATA_DIR=" + File("environment")}),
              HasSubstr("data " + File("environment") + "/orbitune.db\nthreads 4"));
  EXPECT_THAT(started_with({"--threads", "6"}, {config, "ORBITUNE_THREADS=4"}), HasSubstr("threads 6"));
  EXPECT_THAT(started_with({"--config", file}, {"ORBITUNE_THREADS="}), HasSubstr("threads 3"));

  const Result bad_value = RunServer({"--config", file}, {"ORBITUNE_THREADS=x"});
  EXPECT_EQ(bad_value.code, 2);
  EXPECT_THAT(bad_value.err, HasSubstr("--threads"));
  const Result missing = RunServer({}, {"ORBITUNE_CONFIG=" + File("none.toml")});
  EXPECT_EQ(missing.code, 2);
  EXPECT_THAT(missing.err, HasSubstr("none.toml"));
  std::ofstream(file) << "lisen = \"127.0.0.1:0\"\n";
  const Result unknown = RunServer({"--config", file});
  EXPECT_EQ(unknown.code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("lisen"));
}

TEST_F(ProcessTest, TheFirstLinesTellWhereItListens) {
  const auto server = Start("data", "1");
  const std::vector<std::string> lines = LinesOf(server->process().out());
  EXPECT_THAT(lines[0], StartsWith("orbituned "));
  EXPECT_THAT(lines[1], MatchesRegex("grpc 127.0.0.1:[0-9]+"));
  EXPECT_THAT(lines[2], MatchesRegex("http 127.0.0.1:[0-9]+"));
  EXPECT_EQ(lines[3], "data " + File("data") + "/orbitune.db");
  EXPECT_THAT(lines[4], StartsWith("threads 1"));
}

TEST_F(ProcessTest, TheCliTunesFromEndToEnd) {
  const auto server = Start("data");
  const Result submitted = RunCli(*server, {"submit", "--scenario", "gto-geo", "--iterations", "15", "--directions",
                                            "4", "--label", "case=1", "--watch"});
  EXPECT_EQ(submitted.code, 0) << submitted.err;
  EXPECT_EQ(submitted.err, "");
  const std::vector<std::string> lines = LinesOf(submitted.out);
  for (int iteration = 1; iteration <= 15; ++iteration) {
    const std::string start = "iteration " + std::to_string(iteration) + "/15  J ";
    EXPECT_EQ(std::ranges::count_if(lines, [&](const std::string& line) { return line.starts_with(start); }), 1);
  }
  EXPECT_EQ(submitted.out.find('\r'), std::string::npos);
  EXPECT_EQ(submitted.out.find('\x1b'), std::string::npos);
  for (const char* part : {"state SUCCEEDED", "K(1)      0.1 1 1 1 10", "K(15)", "best K", "reduction", "cost J",
                           "812.628", "stays in the domain"}) {
    EXPECT_THAT(submitted.out, HasSubstr(part));
  }

  const std::string job = lines[0].substr(0, lines[0].find(' '));
  EXPECT_THAT(RunCli(*server, {"jobs", "--label", "case=1", "--state", "succeeded"}).out, HasSubstr(job.substr(5)));
  EXPECT_EQ(LinesOf(RunCli(*server, {"history", job}).out).size(), 16u);
  EXPECT_EQ(RunCli(*server, {"watch", job}).code, 0);
  EXPECT_EQ(RunCli(*server, {"show", job}).code, 0);
  EXPECT_EQ(RunCli(*server, {"simulate", "--job", job, "--which", "best"}).code, 0);
  EXPECT_EQ(LinesOf(RunCli(*server, {"--json", "watch", job}).out).size(), 19u);  // snapshot, 15, three states
  EXPECT_EQ(RunCli(*server, {"cancel", job}).code, 5);
}

TEST_F(ProcessTest, TheCliTellsAJobThatLeavesTheDomain) {
  const auto server = Start("data");
  const Result result = RunCli(*server, {"submit", "--scenario", "gto-geo-printed", "--watch"});
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.out + result.err, HasSubstr("left the domain of the error coordinates at t = 548.7"));
  EXPECT_THAT(result.out + result.err, HasSubstr("the angular momentum reached zero"));
  EXPECT_EQ(RunCli(*server, {"simulate", "--scenario", "gto-geo-printed"}).code, 1);
  EXPECT_EQ(RunCli(*server, {"scenarios"}).code, 0);
}

TEST_F(ProcessTest, TheCliTellsBadInput) {
  const auto server = Start("data");
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"--scenario", "mars"}, "job.scenario"},
      {{"--scenario", "gto-geo", "--directions", "0"}, "job.hyperparameters.directions"},
      {{"--scenario", "gto-geo", "--iterations", "1000000000"}, "job.hyperparameters.iterations"},
      {{"--scenario", "gto-geo", "--step-size", "nan"}, "step"},
      {{"--scenario", "gto-geo", "--initial-gains", "1,1,-1,1,1"}, "job.hyperparameters.initial_gains.k3"},
      {{"--scenario", "gto-geo", "--ic", "p_km=0,ex=0,ey=0,hx=0,hy=0,true_longitude_deg=0"}, "p_km"},
      {{"--scenario", "gto-geo", "--name", std::string(100'000, 'x')}, "job.display_name"}};
  for (const auto& [arguments, field] : cases) {
    std::vector<std::string> command = {"submit"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const Result result = RunCli(*server, command);
    EXPECT_EQ(result.code, 2) << result.out;
    EXPECT_THAT(result.err, HasSubstr("INVALID_ARGUMENT"));
    EXPECT_THAT(result.err, HasSubstr(field));
    EXPECT_LT(result.err.size(), 5000u);
  }
  EXPECT_EQ(RunCli(*server, {"show", "none"}).code, 3);
}

// Ctrl-C leaves the job running and says how to watch it again.
TEST_F(ProcessTest, AnInterruptedWatchLeavesItsJob) {
  const auto server = Start("data");
  Client client(server->address());
  const std::string job = client.Create(SearchOptions::kMaxIterations);
  Process watch(NextPrefix(), {ORBITUNE_CLI, "--server", server->address(), "watch", job});
  while (watch.out().find("iteration 3/") == std::string::npos) {
    ASSERT_FALSE(watch.Ended()) << watch.err();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  watch.Signal(SIGINT);
  EXPECT_EQ(watch.Wait(), 130);
  EXPECT_THAT(watch.err(), HasSubstr("watch " + job));
  EXPECT_EQ(client.Get(job).state(), v1::JOB_STATE_RUNNING);
  EXPECT_EQ(RunCli(*server, {"cancel", job}).code, 0);
}

// The CLI's own watch goes on after a kill, and prints each iteration once.
TEST_F(ProcessTest, TheClisWatchOutlivesAKilledServer) {
  auto server = Start("data");
  std::string name;
  {
    Client client(server->address());
    name = CreateLonger(client);
  }
  const std::string address = server->address();
  Process watch(NextPrefix(), {ORBITUNE_CLI, "--server", address, "watch", name});
  while (watch.out().find("iteration 20/") == std::string::npos) {
    ASSERT_FALSE(watch.Ended()) << watch.err();
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  server->KillHard();
  server = std::make_unique<Server>(
      NextPrefix(), std::vector<std::string>{"--data-dir", File("data"), "--listen", address, "--threads", "2"});
  EXPECT_EQ(watch.Wait(), 0) << watch.err();
  std::vector<std::string> iterations;
  for (const std::string& line : LinesOf(watch.out())) {
    if (line.starts_with("iteration ")) iterations.push_back(line.substr(0, line.find("  ")));
  }
  ASSERT_EQ(iterations.size(), std::size_t{kLonger});
  for (std::size_t i = 0; i < iterations.size(); ++i) {
    EXPECT_EQ(iterations[i], "iteration " + std::to_string(i + 1) + "/" + std::to_string(kLonger));
  }
}

}  // namespace
}  // namespace orbitune::server_test
