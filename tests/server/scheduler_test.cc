#include "server/jobs/scheduler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <future>
#include <random>

#include "core/scenario/presets.h"
#include "core/sim/scalar_simulator.h"
#include "core/simd/lane_kernel.h"
#include "storage/serialise.h"
#include "tests/server/engine_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::Each;
using ::testing::Ge;
using ::testing::HasSubstr;

// Which job each publication was of, in the order of the commits. Of jobs that are in the store already.
class PublicationLog {
 public:
  PublicationLog(EventHub& hub, const std::vector<std::string>& ids) {
    for (const std::string& id : ids) {
      // Events of stored jobs are all published by the store's writer, one after the other.
      subscriptions_.push_back(hub.Subscribe(id, [this, id] { order_.push_back(id); }));
    }
  }

  // The events in their order; job by job they are `engine`'s, of which the first was not published.
  std::vector<std::pair<std::string, JobEvent>> Events(Engine& engine) {
    engine.store().Flush();  // what is on disk is published a moment later
    subscriptions_.clear();
    std::map<std::string, std::vector<JobEvent>> events;
    std::map<std::string, std::size_t> next;
    std::vector<std::pair<std::string, JobEvent>> all;
    for (const std::string& id : order_) {
      if (!events.contains(id)) events[id] = engine.Events(id);
      all.emplace_back(id, events[id].at(++next[id]));
    }
    return all;
  }

 private:
  std::vector<std::string> order_;
  std::vector<EventHub::Subscription> subscriptions_;
};

absl::StatusOr<JobRecord> Call(void (Scheduler::*transition)(const std::string&, const std::string&, Scheduler::Done),
                               Scheduler& scheduler, const std::string& id) {
  std::promise<absl::StatusOr<JobRecord>> answer;
  (scheduler.*transition)(id, "", [&](absl::StatusOr<JobRecord> job) { answer.set_value(std::move(job)); });
  return answer.get_future().get();
}

bool IsState(const JobEvent& event, JobState state) {
  const auto* change = std::get_if<StateChange>(&event.what);
  return change != nullptr && change->state == state;
}

class SchedulerTest : public ::testing::Test {
 protected:
  std::string NewDatabase() { return directory_.File(std::to_string(++databases_) + ".db"); }

 private:
  TemporaryDirectory directory_;
  int databases_ = 0;
};

TEST_F(SchedulerTest, TheNumberOfThreadsDoesNotShow) {
  const Scenario scenario = SmallScenario();
  const std::vector<IterationRecord> plain = PlainHistory(scenario);
  ASSERT_EQ(plain.size(), 40u);
  std::string first_report;
  for (const int threads : {1, 2, 3}) {
    SCOPED_TRACE(threads);
    Engine engine(NewDatabase(), {.threads = threads});
    const std::string id = engine.Create(scenario);
    const JobRecord job = engine.WaitForEnd(id);
    EXPECT_EQ(job.state, JobState::kSucceeded) << job.error_message;
    ExpectSameHistory(engine.History(id), plain);
    ExpectWellFormed(engine.Events(id));
    ASSERT_TRUE(job.report);
    if (first_report.empty()) first_report = ToJson(*job.report);
    EXPECT_EQ(ToJson(*job.report), first_report);
  }
}

TEST_F(SchedulerTest, AJobsRecordTellsWhatItsEventsDo) {
  Engine engine(NewDatabase());
  const std::string id = engine.Create(SmallScenario(5));
  const JobRecord job = engine.WaitForEnd(id);
  const auto events = engine.Events(id);
  ASSERT_EQ(events.size(), 8u);  // QUEUED, RUNNING, five iterations, SUCCEEDED
  EXPECT_EQ(job.last_seq, 8);
  EXPECT_EQ(job.state_changes, 3);
  EXPECT_EQ(job.completed_iterations(), 5);
  EXPECT_EQ(job.create_time_us, std::get<StateChange>(events[0].what).time_us);
  EXPECT_EQ(job.start_time_us, std::get<StateChange>(events[1].what).time_us);
  EXPECT_EQ(job.end_time_us, std::get<StateChange>(events[7].what).time_us);
  EXPECT_EQ(job.report->episodes, 5 * 7);
}

// With one worker the turns are exact.
TEST_F(SchedulerTest, JobsTakeTurns) {
  Engine engine(NewDatabase(), {.threads = 1}, false);
  const std::vector<std::string> ids = {"a", "b", "c"};
  for (const std::string& id : ids) StoreJob(engine.store(), id, SpecOf(SmallScenario(100)));
  PublicationLog log(engine.hub(), ids);
  engine.Start();
  for (const std::string& id : ids) engine.WaitForEnd(id);
  std::map<std::string, int> completed{{"a", 0}, {"b", 0}, {"c", 0}};
  for (const auto& [id, event] : log.Events(engine)) {
    if (std::holds_alternative<IterationRecord>(event.what)) ++completed[id];
    const auto [least, most] = std::ranges::minmax_element(completed, {}, [](const auto& each) { return each.second; });
    // Quick iterations are published a vector's worth at a time.
    ASSERT_LE(most->second - least->second, static_cast<int>(simd::LaneCount()) + 2)
        << "job " << id << " at event " << event.seq;
  }
}

TEST_F(SchedulerTest, ASmallJobDoesNotWaitForALargeOne) {
  Engine engine(NewDatabase(), {.threads = 1}, false);
  Scenario large = SmallScenario(1);
  large.search.directions = SearchOptions::kMaxDirections;
  StoreJob(engine.store(), "large", SpecOf(large));
  StoreJob(engine.store(), "small", SpecOf(SmallScenario(20)));
  PublicationLog log(engine.hub(), {"large", "small"});
  engine.Start();
  engine.WaitForEnd("large");
  engine.WaitForEnd("small");
  int of_large = 0;
  for (const auto& [id, event] : log.Events(engine)) {
    if (id == "large") of_large += std::holds_alternative<IterationRecord>(event.what);
    if (id == "small" && IsState(event, JobState::kSucceeded)) break;
  }
  EXPECT_EQ(of_large, 0);
}

TEST_F(SchedulerTest, SeveralJobsOnSeveralThreadsAreWhatTheyAreAlone) {
  Engine engine(NewDatabase(), {.threads = 3}, false);
  std::vector<std::string> ids;
  std::vector<Scenario> scenarios;
  for (int i = 0; i < 5; ++i) {
    scenarios.push_back(SmallScenario(30));
    scenarios.back().search.seed = static_cast<std::uint64_t>(i);
    ids.push_back(std::to_string(i));
    StoreJob(engine.store(), ids.back(), SpecOf(scenarios.back()));
  }
  PublicationLog log(engine.hub(), ids);
  engine.Start();
  for (std::size_t i = 0; i < ids.size(); ++i) {
    EXPECT_EQ(engine.WaitForEnd(ids[i]).state, JobState::kSucceeded);
    ExpectSameHistory(engine.History(ids[i]), PlainHistory(scenarios[i]));
    ExpectWellFormed(engine.Events(ids[i]));
  }
  // None ends before every other has got somewhere.
  std::map<std::string, int> completed;
  for (const auto& [id, event] : log.Events(engine)) {
    if (std::holds_alternative<IterationRecord>(event.what)) ++completed[id];
    if (IsState(event, JobState::kSucceeded)) break;
  }
  EXPECT_EQ(completed.size(), ids.size());
}

TEST_F(SchedulerTest, RunsNoMoreJobsThanAllowedAndInTheOrderOfTheirCreation) {
  Engine engine(NewDatabase(), {.threads = 2, .max_running_jobs = 2}, false);
  std::vector<std::string> ids;
  for (int i = 0; i < 6; ++i) {
    ids.push_back(std::string(1, static_cast<char>('f' - i)));
    StoreJob(engine.store(), ids.back(), SpecOf(SmallScenario(5 + i)));
  }
  PublicationLog log(engine.hub(), ids);
  engine.Start();
  for (const std::string& id : ids) EXPECT_EQ(engine.WaitForEnd(id).state, JobState::kSucceeded);
  int running = 0;
  std::vector<std::string> begun;
  for (const auto& [id, event] : log.Events(engine)) {
    if (IsState(event, JobState::kRunning)) begun.push_back(id);
    running += IsState(event, JobState::kRunning) - IsState(event, JobState::kSucceeded);
    ASSERT_LE(running, 2);
  }
  EXPECT_EQ(begun, ids);
}

TEST_F(SchedulerTest, CancelFreesThePoolAndKeepsWhatIsStored) {
  Engine engine(NewDatabase(), {.threads = 2, .max_running_jobs = 1});
  const std::string endless = engine.Create(EndlessScenario());
  const std::string next = engine.Create(SmallScenario(5));
  engine.WaitForIterations(endless, 3);
  EXPECT_EQ(engine.Get(next).state, JobState::kQueued);
  const auto cancelled = Call(&Scheduler::Cancel, engine.scheduler(), endless);
  ASSERT_TRUE(cancelled.ok()) << cancelled.status();
  EXPECT_EQ(cancelled->state, JobState::kCancelled);
  EXPECT_EQ(engine.WaitForEnd(next).state, JobState::kSucceeded);

  // What was in flight when it was cancelled leaves nothing behind.
  engine.store().Flush();
  const JobRecord job = engine.Get(endless);
  EXPECT_EQ(job.last_seq, cancelled->last_seq);
  EXPECT_EQ(job.completed_iterations(), cancelled->completed_iterations());
  ExpectWellFormed(engine.Events(endless));
  Scenario as_far = EndlessScenario();
  as_far.search.iterations = job.completed_iterations();
  ExpectSameHistory(engine.History(endless), PlainHistory(as_far));
}

TEST_F(SchedulerTest, QueuedAndPausedJobsCanBeCancelled) {
  Engine engine(NewDatabase(), {.threads = 1, .max_running_jobs = 1});
  const std::string endless = engine.Create(EndlessScenario());
  const std::string queued = engine.Create(SmallScenario(5));
  const std::string paused = engine.Create(SmallScenario(5));
  ASSERT_TRUE(Call(&Scheduler::Pause, engine.scheduler(), paused).ok());
  for (const std::string& id : {queued, paused, endless}) {
    const auto job = Call(&Scheduler::Cancel, engine.scheduler(), id);
    ASSERT_TRUE(job.ok()) << job.status();
    EXPECT_EQ(engine.Get(id).state, JobState::kCancelled);
    EXPECT_NE(engine.Get(id).end_time_us, 0);
    ExpectWellFormed(engine.Events(id));
  }
}

TEST_F(SchedulerTest, APausedJobStandsStillAndLetsOthersRun) {
  Engine engine(NewDatabase(), {.threads = 2, .max_running_jobs = 1});
  const std::string endless = engine.Create(EndlessScenario());
  engine.WaitForIterations(endless, 2);
  const auto paused = Call(&Scheduler::Pause, engine.scheduler(), endless);
  ASSERT_TRUE(paused.ok()) << paused.status();
  EXPECT_EQ(paused->state, JobState::kPaused);
  const std::string other = engine.Create(SmallScenario(20));
  EXPECT_EQ(engine.WaitForEnd(other).state, JobState::kSucceeded);
  engine.store().Flush();
  EXPECT_EQ(engine.Get(endless).last_seq, paused->last_seq);
}

// Pauses, resumes and restarts at random moments; the history must not tell.
TEST_F(SchedulerTest, InterruptionsDoNotShow) {
  const Scenario scenario = SmallScenario(200);
  const std::vector<IterationRecord> plain = PlainHistory(scenario);
  std::mt19937 random(7);
  std::string report;
  for (int round = 0; round < 6; ++round) {
    SCOPED_TRACE(round);
    const std::string database = NewDatabase();
    auto engine = std::make_unique<Engine>(database, Scheduler::Options{.threads = 1 + round % 3});
    const std::string id = engine->Create(scenario);
    for (int interruption = 0; interruption < 20; ++interruption) {
      std::this_thread::sleep_for(std::chrono::microseconds(random() % 4000));
      if (random() % 4 == 0) {
        engine.reset();
        engine = std::make_unique<Engine>(database, Scheduler::Options{.threads = 1 + static_cast<int>(random() % 3)});
        continue;
      }
      const auto paused = Call(&Scheduler::Pause, engine->scheduler(), id);
      if (!paused.ok()) {
        ASSERT_TRUE(absl::IsFailedPrecondition(paused.status())) << paused.status();
        break;  // it is over
      }
      ASSERT_EQ(paused->state, JobState::kPaused);
      if (random() % 2 == 0) std::this_thread::sleep_for(std::chrono::microseconds(random() % 2000));
      const auto resumed = Call(&Scheduler::Resume, engine->scheduler(), id);
      ASSERT_TRUE(resumed.ok()) << resumed.status();
    }
    const JobRecord job = engine->WaitForEnd(id);
    ASSERT_EQ(job.state, JobState::kSucceeded) << job.error_message;
    ExpectSameHistory(engine->History(id), plain);
    ExpectWellFormed(engine->Events(id));
    if (report.empty()) report = ToJson(*job.report);
    EXPECT_EQ(ToJson(*job.report), report);
  }
}

TEST_F(SchedulerTest, CancelAtAnyMomentLeavesAPrefix) {
  const std::vector<IterationRecord> plain = PlainHistory(SmallScenario(200));
  Engine engine(NewDatabase(), {.threads = 3});
  std::mt19937 random(3);
  for (int round = 0; round < 20; ++round) {
    const std::string id = engine.Create(SmallScenario(200));
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 8000));
    const auto cancelled = Call(&Scheduler::Cancel, engine.scheduler(), id);
    EXPECT_TRUE(cancelled.ok() || absl::IsFailedPrecondition(cancelled.status())) << cancelled.status();
    EXPECT_EQ(engine.WaitForEnd(id).state, cancelled.ok() ? JobState::kCancelled : JobState::kSucceeded);
    ExpectPrefix(engine.History(id), plain);
    ExpectWellFormed(engine.Events(id));
  }
}

TEST_F(SchedulerTest, ManyThreadsMaySteerOneJob) {
  const Scenario scenario = SmallScenario(400);
  Engine engine(NewDatabase(), {.threads = 2});
  const std::string id = engine.Create(scenario);
  std::vector<std::thread> users;
  for (int user = 0; user < 3; ++user) {
    users.emplace_back([&, user] {
      for (int i = 0; i < 20; ++i) {
        const auto transition = (i + user) % 2 == 0 ? &Scheduler::Pause : &Scheduler::Resume;
        const auto answer = Call(transition, engine.scheduler(), id);
        ASSERT_TRUE(answer.ok() || absl::IsFailedPrecondition(answer.status())) << answer.status();
      }
    });
  }
  for (std::thread& user : users) user.join();
  (void)Call(&Scheduler::Resume, engine.scheduler(), id);
  EXPECT_EQ(engine.WaitForEnd(id).state, JobState::kSucceeded);
  ExpectSameHistory(engine.History(id), PlainHistory(scenario));
  ExpectWellFormed(engine.Events(id));
}

TEST_F(SchedulerTest, ASlowDiskHoldsBackAJobNotItsResults) {
  const Scenario scenario = SmallScenario(30);
  Engine engine(NewDatabase(), {.threads = 3, .max_uncommitted_iterations = 1});
  const std::string id = engine.Create(scenario);
  EXPECT_EQ(engine.WaitForEnd(id).state, JobState::kSucceeded);
  ExpectSameHistory(engine.History(id), PlainHistory(scenario));
}

TEST_F(SchedulerTest, TakesUpWhatAKilledServerLeft) {
  const Scenario scenario = SmallScenario(20);
  const std::vector<IterationRecord> plain = PlainHistory(scenario);
  for (const std::size_t kept : {0u, 1u, 7u, 19u, 20u}) {
    SCOPED_TRACE(kept);
    Engine engine(NewDatabase(), {.threads = 2}, false);
    StoreRunningJob(engine.store(), "killed", SpecOf(scenario),
                    {plain.begin(), plain.begin() + static_cast<std::ptrdiff_t>(kept)});
    engine.Start();
    EXPECT_EQ(engine.WaitForEnd("killed").state, JobState::kSucceeded);
    ExpectSameHistory(engine.History("killed"), plain);
    ExpectWellFormed(engine.Events("killed"));
  }
}

TEST_F(SchedulerTest, APausedJobStaysPausedOverARestart) {
  const Scenario scenario = SmallScenario(1500);
  const std::string database = NewDatabase();
  std::string id;
  {
    Engine engine(database);
    id = engine.Create(scenario);
    ASSERT_TRUE(Call(&Scheduler::Pause, engine.scheduler(), id).ok());
  }
  Engine engine(database);
  EXPECT_EQ(engine.WaitForEnd(engine.Create(SmallScenario(3))).state, JobState::kSucceeded);
  EXPECT_EQ(engine.Get(id).state, JobState::kPaused);
  ASSERT_TRUE(Call(&Scheduler::Resume, engine.scheduler(), id).ok());
  EXPECT_EQ(engine.WaitForEnd(id).state, JobState::kSucceeded);
  ExpectSameHistory(engine.History(id), PlainHistory(scenario));
}

TEST_F(SchedulerTest, RefusesToGoOnFromAHistoryThatIsNotItsOwn) {
  const Scenario scenario = SmallScenario(20);
  std::vector<IterationRecord> history = PlainHistory(scenario);
  history.resize(6);
  history.back().cost = std::nextafter(history.back().cost, 0.0);
  Engine engine(NewDatabase(), {.threads = 2}, false);
  StoreRunningJob(engine.store(), "tampered", SpecOf(scenario), history);
  StoreJob(engine.store(), "other", SpecOf(scenario));
  engine.Start();
  const JobRecord job = engine.WaitForEnd("tampered");
  EXPECT_EQ(job.state, JobState::kFailed);
  EXPECT_THAT(job.error_message, HasSubstr("iteration 6"));
  EXPECT_THAT(job.error_message, HasSubstr("this server's numerics are not those that the job was begun with"));
  ExpectSameHistory(engine.History("tampered"), history);
  EXPECT_EQ(engine.WaitForEnd("other").state, JobState::kSucceeded);
}

TEST_F(SchedulerTest, AJobThatLeavesTheDomainSaysWhenAndWhy) {
  Engine engine(NewDatabase());
  NewJob job;
  job.scenario.preset_id = "gto-geo-printed";
  const auto created = engine.use_cases().CreateJob(job, "", false);
  ASSERT_TRUE(created.ok()) << created.status();
  const JobRecord ended = engine.WaitForEnd(created->id);
  EXPECT_EQ(ended.state, JobState::kFailed);
  EXPECT_THAT(ended.error_message, HasSubstr("iteration 1: all 16 pairs of episodes left the domain"));
  EXPECT_THAT(ended.error_message, HasSubstr("Under K(1): left the domain"));
  EXPECT_THAT(ended.error_message, HasSubstr("at t = 548.7"));
  EXPECT_THAT(ended.error_message, HasSubstr("the angular momentum reached zero"));
  ExpectWellFormed(engine.Events(created->id));
  EXPECT_EQ(engine.WaitForEnd(engine.Create(SmallScenario(3))).state, JobState::kSucceeded);
}

std::vector<WarningKind> KindsOf(const JobReport& report) {
  std::vector<WarningKind> kinds;
  for (const Warning& warning : report.warnings) kinds.push_back(warning.kind);
  return kinds;
}

TEST_F(SchedulerTest, TheReportIsOfFullHorizonEpisodes) {
  Scenario scenario = SmallScenario(10);
  scenario.horizon_samples = 400;
  Engine engine(NewDatabase());
  const JobRecord job = engine.WaitForEnd(engine.Create(scenario));
  ASSERT_TRUE(job.report);
  const JobReport& report = *job.report;
  EXPECT_EQ(report.initial.iteration, 1);
  EXPECT_EQ(report.final.iteration, 10);
  const auto prepared = Prepare(scenario);
  ASSERT_TRUE(prepared.ok());
  const std::vector<IterationRecord> plain = PlainHistory(scenario);
  for (const GainsAssessment* assessed : {&report.initial, &report.final, &report.best}) {
    const IterationRecord& record = plain[static_cast<std::size_t>(assessed->iteration) - 1];
    const EpisodeResult episode =
        SimulateEpisode(prepared->problem, record.gains, {.early_exit = false, .measure_effort = true});
    EXPECT_EQ(assessed->gains, record.gains);
    EXPECT_EQ(assessed->episode.outcome, Outcome::kSettled);
    EXPECT_EQ(assessed->episode.cost, episode.cost);
    EXPECT_NEAR(assessed->episode.cost, record.cost, 1e-5 * record.cost);
    EXPECT_EQ(assessed->episode.settling_time_s, episode.settling_samples * 180.0);
    EXPECT_EQ(assessed->episode.delta_v_horizon_m_s, episode.delta_v_horizon * prepared->units.velocity_m_s());
    EXPECT_EQ(assessed->episode.end_time_s, episode.end_time * prepared->units.time_s);
  }
  EXPECT_EQ(report.best.iteration, std::ranges::min_element(plain, Better)->iteration);
}

TEST_F(SchedulerTest, WarnsOfAGainOnItsFloorAndOfNotSettling) {
  Scenario scenario = SmallScenario(5);
  scenario.search.gain_floor = scenario.search.initial_gains[0];
  scenario.search.exploration_std[0] = 0;
  Engine engine(NewDatabase());
  const JobRecord job = engine.WaitForEnd(engine.Create(scenario));
  ASSERT_TRUE(job.report);
  EXPECT_THAT(KindsOf(*job.report), ::testing::IsSupersetOf({WarningKind::kGainAtFloor, WarningKind::kNotSettled}));
  EXPECT_THAT(job.report->warnings[0].message, HasSubstr("K1 of iteration 5 is on its floor of 0.1"));
}

TEST_F(SchedulerTest, WarnsOfAnEngineThereIsNotAndOfALastThatIsNotTheBest) {
  Scenario scenario = *FindPreset("gto-geo");
  scenario.horizon_samples = 100;
  scenario.integration_tolerance = 1e-6;
  scenario.search.iterations = 8;
  scenario.search.directions = 2;
  scenario.search.step_size = 5;
  Engine engine(NewDatabase());
  const JobRecord job = engine.WaitForEnd(engine.Create(scenario));
  ASSERT_TRUE(job.report) << job.error_message;
  EXPECT_THAT(KindsOf(*job.report),
              ::testing::IsSupersetOf({WarningKind::kPeakAcceleration, WarningKind::kLastNotBest}));
}

// Even where the pairs were left out before a restart.
TEST_F(SchedulerTest, TheReportCountsEveryPairLeftOut) {
  const Scenario scenario = EdgeScenario(6);
  const std::vector<IterationRecord> plain = PlainHistory(scenario);
  ASSERT_EQ(plain.size(), 6u);
  const auto left_out_by = [&](std::ptrdiff_t iterations) {
    int sum = 0;
    for (std::ptrdiff_t i = 0; i < iterations; ++i) sum += plain[static_cast<std::size_t>(i)].pairs_left_out;
    return sum;
  };
  ASSERT_GT(left_out_by(3), 0) << "the scenario is on no edge";
  std::string unbroken;
  for (const std::ptrdiff_t kept : {0, 3, 6}) {
    SCOPED_TRACE(kept);
    Engine engine(NewDatabase(), {.threads = 2}, false);
    StoreRunningJob(engine.store(), "a", SpecOf(scenario), {plain.begin(), plain.begin() + kept});
    engine.Start();
    const JobRecord job = engine.WaitForEnd("a");
    ASSERT_TRUE(job.report) << job.error_message;
    EXPECT_EQ(job.report->warnings.back().kind, WarningKind::kPairsLeftOut);
    EXPECT_THAT(job.report->warnings.back().message, HasSubstr(std::to_string(left_out_by(6)) + " of 36 pairs"));
    if (unbroken.empty()) unbroken = ToJson(*job.report);
    EXPECT_EQ(ToJson(*job.report), unbroken);
  }
}

}  // namespace
}  // namespace orbitune::server_test
