// The server killed (SIGKILL) at random moments, again and again, while clients create jobs and campaigns and watch
// them: what was acknowledged is there, everything ends, and comes out as on a server that nobody disturbs.
//   ORBITUNE_CRASHES=200 orbitune_server_durability_test --gtest_filter=Crash*    the long form
#include <gtest/gtest.h>
#include <signal.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <map>
#include <mutex>
#include <random>
#include <set>
#include <shared_mutex>
#include <thread>

#include "orbitune/v1/campaign.grpc.pb.h"
#include "orbitune/v1/gains.grpc.pb.h"
#include "server/api/json.h"
#include "tests/server/engine_support.h"
#include "tests/server/process_support.h"
#include "tests/server/rest_support.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

constexpr int kSpecs = 5;
constexpr int kUnfinishedJobs = 4;  // as many as are kept going
constexpr int kWatchers = 4;        // over gRPC; one more over HTTP

int CrashesWanted() {
  const char* crashes = std::getenv("ORBITUNE_CRASHES");
  return crashes == nullptr ? 6 : std::atoi(crashes);
}

// Some hundreds of milliseconds each: ARS of two sizes, CMA-ES, whose checkpoints count, and Nelder-Mead.
v1::CreateJobRequest JobRequest(int spec, const std::string& request_id = "") {
  v1::CreateJobRequest request;
  request.set_request_id(request_id);
  v1::Job& job = *request.mutable_job();
  job.set_scenario("scenarios/gto-geo");
  job.set_display_name("spec " + std::to_string(spec));
  v1::Hyperparameters& search = *job.mutable_hyperparameters();
  search.set_seed(static_cast<std::uint64_t>(7 + spec));
  if (spec < 3) {
    search.set_iterations(spec == 0 ? 1500 : 400);
    search.set_directions(spec == 1 ? 24 : 8);
  }
  if (spec == 3) search.set_algorithm(v1::ALGORITHM_CMA_ES);
  if (spec == 4) search.set_algorithm(v1::ALGORITHM_NELDER_MEAD);
  if (spec >= 3) search.set_max_episodes(spec == 3 ? 6000 : 1500);
  return request;
}

v1::CreateCampaignRequest CampaignRequest(const std::string& request_id = "") {
  v1::CreateCampaignRequest request;
  request.set_request_id(request_id);
  v1::Campaign& campaign = *request.mutable_campaign();
  *campaign.mutable_scenario_definition() = SmallDefinition(300);
  campaign.mutable_initial_conditions()->mutable_draw()->set_count(3);
  campaign.mutable_held_out()->mutable_draw()->set_count(2);
  campaign.mutable_robust()->mutable_hyperparameters()->set_max_episodes(1000);
  return request;
}

// All that a job came to, and what it must be whoever disturbed it.
struct Story {
  std::string iterations;
  std::string report;
  std::string digest;
  std::string gains;

  bool operator==(const Story&) const = default;
};

Story StoryOf(Client& client, const std::string& job_name) {
  const v1::Job job = client.WaitForEnd(job_name);
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job_name << ": " << job.error_message();
  v1::GetGainSetRequest request;
  request.set_name("gainSets/" + job_name.substr(std::string("jobs/").size()));
  v1::GainSet set;
  grpc::ClientContext context;
  const auto stub = v1::GainService::NewStub(client.channel());
  const grpc::Status status = stub->GetGainSet(&context, request, &set);
  EXPECT_TRUE(status.ok()) << request.name() << ": " << status.error_message();
  EXPECT_NE(job.provenance().digest(), "");
  return {client.Iterations(job_name).SerializeAsString(), job.report().SerializeAsString(), job.provenance().digest(),
          set.gains().SerializeAsString() + set.flight().SerializeAsString()};
}

// Its members with all that came of them, less the names of its jobs, and its results.
std::string CampaignStoryOf(Client& client, const std::string& name) {
  const auto stub = v1::CampaignService::NewStub(client.channel());
  v1::ListCampaignMembersRequest request;
  request.set_parent(name);
  v1::ListCampaignMembersResponse members;
  grpc::ClientContext context;
  EXPECT_TRUE(stub->ListCampaignMembers(&context, request, &members).ok());
  std::string story;
  for (v1::CampaignMember& member : *members.mutable_members()) {
    if (!member.job().empty()) {
      story += client.Iterations(member.job()).SerializeAsString();
      story += client.Get(member.job()).provenance().digest();
    }
    member.clear_job();
    story += member.SerializeAsString();
  }
  v1::GetCampaignRequest get;
  get.set_name(name);
  v1::Campaign campaign;
  grpc::ClientContext another;
  EXPECT_TRUE(stub->GetCampaign(&another, get, &campaign).ok());
  EXPECT_EQ(campaign.state(), v1::CAMPAIGN_STATE_SUCCEEDED) << campaign.error_message();
  return story + campaign.results().SerializeAsString();
}

// What there was to be heard of one job, over all connections.
struct Heard {
  std::int64_t last_seq = 0;
  v1::ListIterationsResponse iterations;
  bool ended = false;

  // False: it is not the next event.
  bool Take(const v1::WatchJobResponse& event) {
    if (event.has_snapshot()) return true;
    if (event.seq() != last_seq + 1) return false;
    ++last_seq;
    if (event.has_iteration()) *iterations.add_iterations() = event.iteration();
    if (event.has_state_change()) ended = HasEnded(event.state_change().state());
    return true;
  }
};

// The server that is killed and started again, where everybody finds the present one.
class Killed {
 public:
  explicit Killed(TemporaryDirectory& directory) : directory_(directory) { Start(); }

  struct Place {
    std::string grpc;
    std::string http;  // empty: it is killed
    int life = 0;
  };
  Place place() {
    const std::lock_guard lock(mutex_);
    return place_;
  }
  // Until there is another server than that of `life`, or none will come.
  void AwaitNext(int life) {
    while (!over && place().life == life) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }

  void KillAndStart() {
    Kill();
    Start();
  }
  // One more kill, in the middle of a start.
  void KillAStart(std::chrono::milliseconds after) {
    Kill();
    Process starting(Prefix(), ServerCommand(Arguments()));
    std::this_thread::sleep_for(after);
    starting.Signal(SIGKILL);
    starting.Wait();
  }

  void StartAgain() { Start(); }
  int Terminate() { return server_->Terminate(); }

  std::atomic<bool> over = false;  // no more kills: the server that is there stays
  std::shared_mutex open_mutex;    // held while a connection is made that must not be refused

 private:
  std::string Prefix() { return directory_.File("crashed-" + std::to_string(++processes_)); }
  std::vector<std::string> Arguments() {
    return {"--data-dir", directory_.File("crashed"), "--listen", "127.0.0.1:0", "--threads", "2"};
  }
  void Kill() {
    const std::unique_lock no_opening(open_mutex);
    const std::lock_guard lock(mutex_);
    place_.http.clear();
    server_->KillHard();
  }
  void Start() {
    server_ = std::make_unique<Server>(Prefix(), Arguments());
    const std::lock_guard lock(mutex_);
    place_ = {server_->address(), server_->http_address(), place_.life + 1};
  }

  TemporaryDirectory& directory_;
  int processes_ = 0;
  std::unique_ptr<Server> server_;
  std::mutex mutex_;
  Place place_;  // guarded by mutex_
};

class CrashTest : public ::testing::Test {
 protected:
  void TearDown() override {
    for (std::thread& thread : threads_) thread.join();
  }

  // On a server that nobody disturbs.
  void MakeReference() {
    Server server(directory_.File("good"),
                  {"--data-dir", directory_.File("good-data"), "--listen", "127.0.0.1:0", "--threads", "2"});
    Client client(server.address());
    std::vector<std::string> names;
    for (int spec = 0; spec < kSpecs; ++spec) {
      v1::Job job;
      const grpc::Status status = client.Create(JobRequest(spec), &job);
      ASSERT_TRUE(status.ok()) << status.error_message();
      names.push_back(job.name());
    }
    const auto stub = v1::CampaignService::NewStub(client.channel());
    v1::Campaign campaign;
    grpc::ClientContext context;
    ASSERT_TRUE(stub->CreateCampaign(&context, CampaignRequest(), &campaign).ok());
    for (const std::string& name : names) good_.push_back(StoryOf(client, name));
    AwaitCampaign(client, campaign.name());
    good_campaign_ = CampaignStoryOf(client, campaign.name());
    ASSERT_GT(good_[0].iterations.size(), 50'000u);
    ASSERT_GT(good_campaign_.size(), 10'000u);
  }

  static void AwaitCampaign(Client& client, const std::string& name) {
    const auto stub = v1::CampaignService::NewStub(client.channel());
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(5);
    v1::GetCampaignRequest request;
    request.set_name(name);
    v1::Campaign campaign;
    do {
      grpc::ClientContext context;
      ASSERT_TRUE(stub->GetCampaign(&context, request, &campaign).ok());
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    } while (campaign.state() < v1::CAMPAIGN_STATE_SUCCEEDED && std::chrono::steady_clock::now() < deadline);
  }

  // Calls until the answer is none of a server that has gone; false: the test is over.
  template <typename Call>
  bool Persist(Killed& killed, const Call& call) {
    while (true) {
      const Killed::Place place = killed.place();
      Client client(place.grpc);
      const grpc::Status status = call(client);
      if (status.ok()) return true;
      if (status.error_code() != grpc::StatusCode::UNAVAILABLE) {
        ADD_FAILURE() << status.error_code() << " " << status.error_message();
        return false;
      }
      if (killed.over) return false;
      killed.AwaitNext(place.life);
    }
  }

  // Keeps some jobs and a campaign going until there are no more kills; every name was acknowledged.
  void Submit(Killed& killed) {
    for (int n = 0; !killed.over; ++n) {
      if (n % 6 == 0) SubmitCampaign(killed, n / 6);
      v1::Job job;
      const int spec = n % kSpecs;
      const std::string request_id = "job " + std::to_string(n);
      if (!Persist(killed, [&](Client& client) { return client.Create(JobRequest(spec, request_id), &job); })) return;
      {
        const std::lock_guard lock(mutex_);
        const bool is_new = jobs_.emplace(job.name(), spec).second;
        EXPECT_TRUE(is_new) << job.name();
        unwatched_.push_back(job.name());
        unfinished_.insert(job.name());
      }
      while (!killed.over && Unfinished() >= kUnfinishedJobs) {
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      }
    }
  }

  void SubmitCampaign(Killed& killed, int n) {
    v1::Campaign campaign;
    const auto request = CampaignRequest("campaign " + std::to_string(n));
    const bool created = Persist(killed, [&](Client& client) {
      grpc::ClientContext context;
      return v1::CampaignService::NewStub(client.channel())->CreateCampaign(&context, request, &campaign);
    });
    if (!created) return;
    const std::lock_guard lock(mutex_);
    campaigns_.push_back(campaign.name());
  }

  std::size_t Unfinished() {
    const std::lock_guard lock(mutex_);
    return unfinished_.size();
  }

  std::size_t Acknowledged() {
    const std::lock_guard lock(mutex_);
    return jobs_.size();
  }

  // The next job to be watched from its first event to its last; empty: all are, and no more will come.
  std::string NextToWatch(Killed& killed) {
    while (true) {
      {
        const std::lock_guard lock(mutex_);
        if (!unwatched_.empty()) {
          const std::string name = unwatched_.back();
          unwatched_.pop_back();
          return name;
        }
      }
      if (killed.over && submitted_) return "";
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }

  void Watch(Killed& killed, bool over_http) {
    for (std::string name = NextToWatch(killed); !name.empty(); name = NextToWatch(killed)) {
      Heard heard;
      while (!heard.ended && !HasFatalFailure()) {
        const Killed::Place place = killed.place();
        const std::string fault =
            over_http ? HearOverHttp(killed, place, name, heard) : HearOverGrpc(place, name, heard);
        ASSERT_EQ(fault, "") << name << " behind " << heard.last_seq;
        ++connections_;
        if (!heard.ended && !killed.over) killed.AwaitNext(place.life);
      }
      const std::lock_guard lock(mutex_);
      heard_[name] = std::move(heard);
      unfinished_.erase(name);
    }
  }

  // Until the stream ends, as it may at any time. Empty, or what is wrong with it.
  static std::string HearOverGrpc(const Killed::Place& place, const std::string& name, Heard& heard) {
    Client client(place.grpc);
    server_test::Watch watch(client, name, heard.last_seq);
    v1::WatchJobResponse event;
    while (watch.Read(&event)) {
      if (!heard.Take(event)) return event.ShortDebugString();
    }
    const grpc::Status status = watch.Finish();
    return status.ok() || status.error_code() == grpc::StatusCode::UNAVAILABLE ? "" : status.error_message();
  }

  static std::string HearOverHttp(Killed& killed, const Killed::Place& place, const std::string& name, Heard& heard) {
    std::unique_ptr<EventStream> stream;
    {
      const std::shared_lock lock(killed.open_mutex);
      if (place.http.empty() || killed.place().http != place.http) return "";
      stream = std::make_unique<EventStream>(
          place.http, "/v1/" + name + ":watch?resume_after_seq=" + std::to_string(heard.last_seq), /*sse=*/true);
    }
    for (StreamEvent event; stream->Read(&event);) {
      if (event.kind == "error") return "";  // a server that goes down says so
      v1::WatchJobResponse message;
      if (!FromJson(event.json, &message).ok()) return "no event: " + event.json;
      if (!heard.Take(message)) return message.ShortDebugString();
      if (!message.has_snapshot() && event.id != std::to_string(heard.last_seq)) return "the id is " + event.id;
    }
    return "";
  }

  TemporaryDirectory directory_;
  std::vector<Story> good_;  // by spec
  std::string good_campaign_;

  std::atomic<bool> submitted_ = false;
  std::atomic<int> connections_ = 0;
  std::mutex mutex_;
  // Guarded by mutex_.
  std::map<std::string, int> jobs_;  // acknowledged, with their specs
  std::vector<std::string> campaigns_;
  std::vector<std::string> unwatched_;
  std::set<std::string> unfinished_;  // jobs whose end nobody has heard
  std::map<std::string, Heard> heard_;

  std::vector<std::thread> threads_;
};

TEST_F(CrashTest, NothingAcknowledgedIsLostAndNothingIsStuck) {
  MakeReference();
  ASSERT_FALSE(HasFailure());
  const int crashes = CrashesWanted();
  const auto seed = static_cast<unsigned>(std::chrono::steady_clock::now().time_since_epoch().count());
  std::mt19937 random(seed);
  SCOPED_TRACE("seed " + std::to_string(seed));
  Killed killed(directory_);
  std::thread submitter([&] {
    Submit(killed);
    submitted_ = true;
  });
  for (int i = 0; i <= kWatchers; ++i) threads_.emplace_back([&, i] { Watch(killed, i == kWatchers); });

  for (int crash = 0; crash < crashes && !HasFailure(); ++crash) {
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 500));
    if (crash % 5 == 4) {
      killed.KillAStart(std::chrono::milliseconds(random() % 150));
      killed.StartAgain();
    } else {
      killed.KillAndStart();
    }
    if (crash % 20 == 19) std::printf("%d kills, %zu jobs acknowledged\n", crash + 1, Acknowledged());
  }
  killed.over = true;
  submitter.join();
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
  ASSERT_FALSE(HasFailure());

  Client client(killed.place().grpc);
  ASSERT_EQ(heard_.size(), jobs_.size());
  std::int64_t iterations = 0;
  for (const auto& [name, spec] : jobs_) {
    SCOPED_TRACE(name);
    const Story story = StoryOf(client, name);
    EXPECT_EQ(story.digest, good_[static_cast<std::size_t>(spec)].digest);
    EXPECT_TRUE(story == good_[static_cast<std::size_t>(spec)]);
    EXPECT_TRUE(heard_[name].iterations.SerializeAsString() == story.iterations);
    EXPECT_EQ(heard_[name].last_seq, client.Get(name).last_seq());
    iterations += heard_[name].iterations.iterations_size();
  }
  for (const std::string& name : campaigns_) {
    SCOPED_TRACE(name);
    AwaitCampaign(client, name);
    EXPECT_TRUE(CampaignStoryOf(client, name) == good_campaign_);
  }
  EXPECT_EQ(killed.Terminate(), 0);
  Process check(directory_.File("check"), ServerCommand({"check", "--data-dir", directory_.File("crashed")}));
  EXPECT_EQ(check.Wait(), 0) << check.out() << check.err();
  std::printf("%d kills: %zu jobs, %zu campaigns, %lld iterations heard over %d connections\n", crashes, jobs_.size(),
              campaigns_.size(), static_cast<long long>(iterations), connections_.load());
}

}  // namespace
}  // namespace orbitune::server_test
