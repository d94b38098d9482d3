#include "tests/server/engine_support.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <future>
#include <thread>

#include "core/library/history_digest.h"
#include "core/scenario/presets.h"
#include "core/search/optimiser.h"
#include "core/simd/batch_simulator.h"
#include "server/jobs/gain_sets.h"

namespace orbitune::server_test {
namespace {

// Waits for the callback of one write.
absl::Status Await(const std::function<void(JobStore::Done)>& write) {
  std::promise<absl::Status> answer;
  write([&answer](absl::Status status) { answer.set_value(std::move(status)); });
  return answer.get_future().get();
}

Scheduler::Options WithLibrary(Scheduler::Options options, GainLibrary& library) {
  options.library = &library;
  return options;
}

}  // namespace

TemporaryDirectory::TemporaryDirectory() {
  std::string name = (std::filesystem::temp_directory_path() / "orbitune-server-XXXXXX").string();
  EXPECT_NE(mkdtemp(name.data()), nullptr);
  path_ = name;
}

TemporaryDirectory::~TemporaryDirectory() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

Scenario SmallScenario(int iterations) {
  Scenario s = *FindPreset("leo-rendezvous");
  s.id = "small";
  s.horizon_samples = 20;
  s.integration_tolerance = 1e-6;
  s.search.iterations = iterations;
  s.search.directions = 3;
  return s;
}

Scenario SmallWith(Algorithm algorithm, int iterations) {
  Scenario s = SmallScenario(iterations);
  s.search.algorithm = algorithm;
  s.search.cma_es = {.population = 6, .initial_sigma = 0.5, .restarts = 2};
  return s;
}

Scenario EndlessScenario() { return SmallScenario(SearchOptions::kMaxIterations); }

Scenario EdgeScenario(int iterations) {
  Scenario s = *FindPreset("gto-geo");
  s.id = "edge";
  std::get<KeplerianState>(s.chaser).argument_of_periapsis_deg = 74;  // at 72 all leave it
  s.horizon_samples = 40;
  s.integration_tolerance = 1e-6;
  s.search.iterations = iterations;
  s.search.directions = 6;
  s.search.exploration_scale = 0.3;
  return s;
}

JobSpec SpecOf(const Scenario& scenario) {
  return {.display_name = "", .labels = {}, .scenario = scenario, .initial_condition = scenario.chaser};
}

NewJob JobOf(const Scenario& scenario) {
  NewJob job;
  job.scenario.definition = scenario;
  return job;
}

EpisodeResult SimulateAlone(const PreparedScenario& prepared, const Gains& gains) {
  const BatchEpisode episode{.problem = &prepared.problem, .gains = gains};
  EpisodeResult result;
  SimulateBatch({&episode, 1}, {&result, 1});
  return result;
}

std::vector<IterationRecord> PlainHistory(const Scenario& scenario) {
  const auto prepared = Prepare(scenario);
  EXPECT_TRUE(prepared.ok()) << prepared.status();
  std::vector<IterationRecord> history;
  const absl::Status status = RunSearch(
      scenario.search,
      [&](std::span<const Gains> gains, std::span<EpisodeResult> results) {
        for (std::size_t i = 0; i < gains.size(); ++i) results[i] = SimulateAlone(*prepared, gains[i]);
      },
      [&](const IterationRecord& record) { history.push_back(record); });
  EXPECT_TRUE(status.ok()) << status;
  return history;
}

Engine::Engine(const std::string& database, Scheduler::Options options, bool start)
    : store_([&] {
        auto store = OpenSqliteStore({.path = database});
        EXPECT_TRUE(store.ok()) << store.status();
        return *std::move(store);
      }()),
      scheduler_(*store_, hub_, WithLibrary(options, library_)),
      use_cases_(*store_, scheduler_, hub_),
      campaign_engine_(*store_, store_->campaigns(), scheduler_, hub_, &library_, kMostCampaigns),
      campaigns_(use_cases_, store_->campaigns(), campaign_engine_),
      gains_(*store_, library_) {
  const absl::Status loaded = LoadLibrary(store_->gains(), library_);
  EXPECT_TRUE(loaded.ok()) << loaded;
  use_cases_.set_gain_sets([this](const std::string& id) { return gains_.WarmStartFrom(id); });
  if (start) Start();
}

Engine::~Engine() {
  campaign_engine_.Stop();
  scheduler_.Stop();
}

void Engine::Start() {
  absl::Status status = scheduler_.Start();
  if (status.ok()) status = campaign_engine_.Start();
  EXPECT_TRUE(status.ok()) << status;
}

std::string Engine::Create(const NewJob& job) {
  const auto created = use_cases_.CreateJob(job, "", false);
  EXPECT_TRUE(created.ok()) << created.status();
  return created.ok() ? created->id : "";
}

std::string Engine::Create(const Scenario& scenario) { return Create(JobOf(scenario)); }

JobRecord Engine::Get(const std::string& id) {
  auto job = use_cases_.GetJob(id);
  EXPECT_TRUE(job.ok()) << job.status();
  return job.ok() ? *std::move(job) : JobRecord{};
}

std::vector<IterationRecord> Engine::History(const std::string& id) {
  auto history = store_->ListIterations(id, 0, 1'000'000);
  EXPECT_TRUE(history.ok()) << history.status();
  return history.ok() ? *std::move(history) : std::vector<IterationRecord>{};
}

std::vector<JobEvent> Engine::Events(const std::string& id) {
  auto events = store_->ListEvents(id, 0, 1'000'000);
  EXPECT_TRUE(events.ok()) << events.status();
  return events.ok() ? *std::move(events) : std::vector<JobEvent>{};
}

JobRecord Engine::WaitFor(const std::string& id, const std::function<bool(const JobRecord&)>& condition) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(3);
  while (true) {
    JobRecord job = Get(id);
    if (job.id.empty() || condition(job)) return job;
    if (std::chrono::steady_clock::now() > deadline) {
      ADD_FAILURE() << "job " << id << " hangs at event " << job.last_seq;
      return job;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

JobRecord Engine::WaitForEnd(const std::string& id) {
  return WaitFor(id, [](const JobRecord& job) { return IsTerminal(job.state); });
}

void Engine::WaitForIterations(const std::string& id, int completed) {
  WaitFor(id, [&](const JobRecord& job) { return job.completed_iterations() >= completed || IsTerminal(job.state); });
}

void StoreJob(JobStore& store, const std::string& id, const JobSpec& spec) {
  std::promise<absl::Status> answer;
  store.CreateJob(id, spec, NowUs(), "", "",
                  [&answer](const absl::StatusOr<JobRecord>& job) { answer.set_value(job.status()); });
  const absl::Status status = answer.get_future().get();
  EXPECT_TRUE(status.ok()) << status;
}

void StoreRunningJob(JobStore& store, const std::string& id, const JobSpec& spec,
                     const std::vector<IterationRecord>& history) {
  StoreJob(store, id, spec);
  std::int64_t seq = 1;
  const StateChange running{.state = JobState::kRunning, .time_us = NowUs(), .message = {}, .report = {}};
  EXPECT_TRUE(Await([&](JobStore::Done done) { store.ChangeState(id, ++seq, running, std::move(done)); }).ok());
  Digest digest = store.GetJob(id)->provenance->digest;
  for (const IterationRecord& record : history) {
    digest = ExtendHistory(digest, record);
    EXPECT_TRUE(Await([&](JobStore::Done done) {
                  store.AppendIteration(id, ++seq, record, {.digest = digest}, std::move(done));
                }).ok());
  }
}

void ExpectPrefix(const std::vector<IterationRecord>& actual, const std::vector<IterationRecord>& expected) {
  ASSERT_LE(actual.size(), expected.size());
  for (std::size_t i = 0; i < actual.size(); ++i) {
    ASSERT_TRUE(Identical(actual[i], expected[i])) << "iteration " << i + 1;
  }
}

void ExpectSameHistory(const std::vector<IterationRecord>& actual, const std::vector<IterationRecord>& expected) {
  EXPECT_EQ(actual.size(), expected.size());
  ExpectPrefix(actual, expected);
}

void ExpectWellFormed(const std::vector<JobEvent>& events) {
  std::int64_t seq = 0;
  int iteration = 0;
  JobState state = JobState::kQueued;
  for (const JobEvent& event : events) {
    ASSERT_EQ(event.seq, ++seq);
    ASSERT_FALSE(IsTerminal(state)) << "event " << seq << " follows the end";
    if (const auto* record = std::get_if<IterationRecord>(&event.what)) {
      ASSERT_EQ(record->iteration, ++iteration);
      ASSERT_EQ(state, JobState::kRunning) << "iteration " << iteration;
      continue;
    }
    const auto& change = std::get<StateChange>(event.what);
    if (seq == 1) {
      ASSERT_EQ(change.state, JobState::kQueued);
      continue;
    }
    switch (change.state) {
      case JobState::kQueued:
        ASSERT_EQ(state, JobState::kPaused);
        break;
      case JobState::kRunning:
        ASSERT_EQ(state, JobState::kQueued);
        break;
      case JobState::kSucceeded:
        ASSERT_EQ(state, JobState::kRunning);
        ASSERT_TRUE(change.report);
        break;
      case JobState::kFailed:
        ASSERT_NE(change.message, "");
        break;
      case JobState::kPaused:
      case JobState::kCancelled:
        break;
    }
    state = change.state;
  }
}

std::vector<std::string> ViolatedFields(const absl::Status& status) {
  std::vector<std::string> fields;
  for (const FieldViolation& violation : FieldViolationsOf(status)) fields.push_back(violation.field);
  return fields;
}

}  // namespace orbitune::server_test
