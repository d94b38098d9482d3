// What the server's tests share: small jobs, an engine on a store of its own, and what the same job gives without one.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/service/campaign_use_cases.h"
#include "server/service/gain_use_cases.h"
#include "storage/sqlite_store.h"

namespace orbitune::server_test {

// A directory of its own, removed with all that is in it.
class TemporaryDirectory {
 public:
  TemporaryDirectory();
  ~TemporaryDirectory();
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;

  std::string File(const std::string& name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

// A rendezvous over a short horizon at a loose tolerance: an iteration takes about a millisecond.
Scenario SmallScenario(int iterations = 40);
Scenario SmallWith(Algorithm algorithm, int iterations = 40);
// So many iterations that a test is over before them.
Scenario EndlessScenario();
// On the edge of the domain: some pairs of episodes leave it, and some do not.
Scenario EdgeScenario(int iterations);

JobSpec SpecOf(const Scenario& scenario);
NewJob JobOf(const Scenario& scenario);

// An episode in a batch of its own.
EpisodeResult SimulateAlone(const PreparedScenario& prepared, const Gains& gains);

// The history of a job as the search gives it with every episode simulated alone, and no server around it.
std::vector<IterationRecord> PlainHistory(const Scenario& scenario);

// Store, hub, scheduler and use cases, wired as in the server.
class Engine {
 public:
  static constexpr int kMostCampaigns = 20;  // of a client

  explicit Engine(const std::string& database, Scheduler::Options options = {.threads = 2}, bool start = true);

  ~Engine();

  JobStore& store() { return *store_; }
  EventHub& hub() { return hub_; }
  Scheduler& scheduler() { return scheduler_; }
  UseCases& use_cases() { return use_cases_; }
  CampaignEngine& campaign_engine() { return campaign_engine_; }
  CampaignUseCases& campaigns() { return campaigns_; }
  GainUseCases& gains() { return gains_; }

  // Each fails the test where the answer is an error.
  void Start();
  std::string Create(const NewJob& job);
  std::string Create(const Scenario& scenario);
  JobRecord Get(const std::string& id);
  std::vector<IterationRecord> History(const std::string& id);
  std::vector<JobEvent> Events(const std::string& id);

  // Fails the test where it takes minutes.
  JobRecord WaitFor(const std::string& id, const std::function<bool(const JobRecord&)>& condition);
  JobRecord WaitForEnd(const std::string& id);
  void WaitForIterations(const std::string& id, int completed);

 private:
  std::unique_ptr<JobStore> store_;
  GainLibrary library_;
  EventHub hub_;
  Scheduler scheduler_;
  UseCases use_cases_;
  CampaignEngine campaign_engine_;
  CampaignUseCases campaigns_;
  GainUseCases gains_;
};

// Puts a job into a store, without an engine. Each waits for the answer and fails the test where it is an error.
void StoreJob(JobStore& store, const std::string& id, const JobSpec& spec);
// A job that runs and has these iterations.
void StoreRunningJob(JobStore& store, const std::string& id, const JobSpec& spec,
                     const std::vector<IterationRecord>& history);

// Fails the test at the first record that differs in a bit. Prefix: `actual` may end earlier.
void ExpectSameHistory(const std::vector<IterationRecord>& actual, const std::vector<IterationRecord>& expected);
void ExpectPrefix(const std::vector<IterationRecord>& actual, const std::vector<IterationRecord>& expected);

// Seqs dense from 1, iterations dense from 1, only the transitions there are, nothing after a terminal state.
void ExpectWellFormed(const std::vector<JobEvent>& events);

// "page_token: must be ..." and so on: every violation, in order.
std::vector<std::string> ViolatedFields(const absl::Status& status);

}  // namespace orbitune::server_test
