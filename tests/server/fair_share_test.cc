// Who begins first and what running jobs get, between clients and between one client's jobs; and the bounds of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <thread>

#include "server/jobs/limit.h"
#include "tests/server/engine_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::HasSubstr;

class FairShareTest : public ::testing::Test {
 protected:
  std::string NewDatabase() { return directory_.File(std::to_string(++databases_) + ".db"); }

  static absl::StatusOr<std::string> Submit(Engine& engine, const Scenario& scenario, const std::string& peer,
                                            int priority = 0) {
    NewJob job = JobOf(scenario);
    job.peer = peer;
    job.priority = priority;
    const auto created = engine.use_cases().CreateJob(job, "", false);
    if (!created.ok()) return created.status();
    return created->id;
  }

  // A job that is in the store when the engine starts.
  static void Put(Engine& engine, const std::string& id, int iterations, const std::string& owner, int priority = 0) {
    JobSpec spec = SpecOf(SmallScenario(iterations));
    spec.owner = owner;
    spec.priority = priority;
    StoreJob(engine.store(), id, spec);
  }

  // How many of the others' events were published before the last of `id`, whose end is awaited.
  static int PublishedBeforeTheEndOf(const std::string& id, const std::vector<std::string>& others, Engine& engine) {
    std::vector<bool> is_others;  // written by the store's writer alone
    std::vector<EventHub::Subscription> subscriptions;
    subscriptions.push_back(engine.hub().Subscribe(id, [&] { is_others.push_back(false); }));
    for (const std::string& other : others) {
      subscriptions.push_back(engine.hub().Subscribe(other, [&] { is_others.push_back(true); }));
    }
    engine.Start();
    engine.WaitForEnd(id);
    subscriptions.clear();
    const auto last = std::ranges::find(is_others.rbegin(), is_others.rend(), false);
    return static_cast<int>(std::count(last, is_others.rend(), true));
  }

  // Which of these jobs began before which, by the order in which their changes were queued.
  static std::vector<std::string> OrderOfBegin(Engine& engine, std::vector<std::string> ids) {
    std::map<std::string, TimeUs> begun;
    for (const std::string& id : ids) begun[id] = engine.Get(id).start_time_us;
    std::ranges::stable_sort(ids, {}, [&](const std::string& id) { return begun.at(id); });
    return ids;
  }

 private:
  TemporaryDirectory directory_;
  int databases_ = 0;
};

// The queue is full of one client's jobs, and as many as may run do: another's job begins all the same, and ends.
TEST_F(FairShareTest, AnothersOneJobBeginsAndEndsBesideMany) {
  Engine engine(NewDatabase(), {.threads = 2, .max_running_jobs = 2});
  std::vector<std::string> many;
  for (int i = 0; i < 30; ++i) {
    const auto id = Submit(engine, EndlessScenario(), "10.0.0.1");
    ASSERT_TRUE(id.ok()) << id.status();
    many.push_back(*id);
  }
  engine.WaitForIterations(many[1], 1);
  const auto one = Submit(engine, SmallScenario(50), "10.0.0.2");
  ASSERT_TRUE(one.ok());
  EXPECT_EQ(engine.WaitForEnd(*one).state, JobState::kSucceeded);
  ExpectSameHistory(engine.History(*one), PlainHistory(SmallScenario(50)));
  EXPECT_EQ(engine.scheduler().counts().queued, 28);
}

// A client with one job gets as much as one with four; without shares the four would have four times as much. No job
// waits for the disk.
TEST_F(FairShareTest, ClientsGetEqualSharesOfTheWorkers) {
  constexpr int kIterations = 3000;
  Engine engine(NewDatabase(), {.threads = 1, .max_uncommitted_iterations = 2 * kIterations}, false);
  const std::vector<std::string> many = {"a1", "a2", "a3", "a4"};
  for (const std::string& id : many) Put(engine, id, kIterations, "a");
  Put(engine, "b", kIterations, "b");
  const int of_many = PublishedBeforeTheEndOf("b", many, engine);
  EXPECT_GE(of_many, kIterations / 2);
  EXPECT_LE(of_many, kIterations * 2);
}

TEST_F(FairShareTest, AClientsRunningJobsShareByPriority) {
  constexpr int kIterations = 3000;
  Engine engine(NewDatabase(), {.threads = 1, .max_uncommitted_iterations = 2 * kIterations}, false);
  Put(engine, "low", kIterations, "a", -1);
  Put(engine, "high", kIterations, "a", 1);
  const int low = PublishedBeforeTheEndOf("high", {"low"}, engine);
  EXPECT_GE(low, kIterations / 20);  // its share is a quarter of high's steps, of which early iterations take more
  EXPECT_LE(low, kIterations / 3);
  EXPECT_EQ(engine.WaitForEnd("low").state, JobState::kSucceeded);
}

TEST_F(FairShareTest, TheHighestPriorityBeginsFirstAndTheOldestEveryEighthTime) {
  Engine engine(NewDatabase(), {.threads = 1, .max_running_jobs = 1}, false);
  Put(engine, "oldest", 1, "a", -4);
  std::vector<std::string> expected;
  for (int i = 0; i < 10; ++i) Put(engine, "normal" + std::to_string(i), 1, "a", 0);
  for (int i = 0; i < 10; ++i) Put(engine, "urgent" + std::to_string(i), 1, "a", 4);
  for (int i = 0; i < 7; ++i) expected.push_back("urgent" + std::to_string(i));
  expected.push_back("oldest");  // the eighth
  for (int i = 7; i < 10; ++i) expected.push_back("urgent" + std::to_string(i));
  for (int i = 0; i < 10; ++i) expected.push_back("normal" + std::to_string(i));
  engine.Start();
  for (const std::string& id : expected) engine.WaitForEnd(id);
  std::vector<std::string> ids = expected;
  std::ranges::sort(ids);
  EXPECT_EQ(OrderOfBegin(engine, ids), expected);
}

// One place to run, two clients: they begin by turns, however many jobs each has.
TEST_F(FairShareTest, ClientsBeginByTurns) {
  Engine engine(NewDatabase(), {.threads = 1, .max_running_jobs = 1}, false);
  std::vector<std::string> all;
  for (int i = 0; i < 6; ++i) all.push_back("a" + std::to_string(i));
  for (int i = 0; i < 2; ++i) all.push_back("b" + std::to_string(i));
  for (const std::string& id : all) Put(engine, id, 3, id.substr(0, 1), 0);
  engine.Start();
  for (const std::string& id : all) engine.WaitForEnd(id);
  const std::vector<std::string> order = OrderOfBegin(engine, all);
  // Both of b's are among the first of a's.
  EXPECT_LE(std::ranges::find(order, "b1") - order.begin(), 4);
}

TEST_F(FairShareTest, PrioritiesAndClientsDoNotShowInResults) {
  Engine engine(NewDatabase(), {.threads = 3, .max_running_jobs = 4}, false);
  std::vector<Scenario> scenarios;
  for (int i = 0; i < 8; ++i) {
    scenarios.push_back(SmallScenario(20));
    scenarios.back().search.seed = static_cast<std::uint64_t>(i);
    JobSpec spec = SpecOf(scenarios.back());
    spec.owner = i % 2 == 0 ? "a" : "b";
    spec.priority = i % 4 - 2;
    StoreJob(engine.store(), std::to_string(i), spec);
  }
  engine.Start();
  for (std::size_t i = 0; i < scenarios.size(); ++i) {
    EXPECT_EQ(engine.WaitForEnd(std::to_string(i)).state, JobState::kSucceeded);
    ExpectSameHistory(engine.History(std::to_string(i)), PlainHistory(scenarios[i]));
  }
}

// Sixty-four episodes of seconds each in the first chunk: minutes for one worker, which is free again as soon as the
// job is not wanted any more.
TEST_F(FairShareTest, EpisodesOfAJobThatIsNotWantedAreBrokenOff) {
  Scenario slow = SmallScenario(1);
  slow.horizon_samples = Scenario::kMaxHorizonSamples;
  slow.sampling_period_s = 900;
  slow.integration_tolerance = 1e-13;
  slow.control_hold = ControlHold::kZeroOrder;  // which has no early exit
  slow.search.initial_gains = {0.01, 0.01, 0.01, 0.01, 0.01};
  slow.search.directions = 32;
  const std::string database = NewDatabase();
  {
    Engine engine(database, {.threads = 1});
    const auto halted = Submit(engine, slow, "a");
    ASSERT_TRUE(halted.ok()) << halted.status();
    engine.WaitFor(*halted, [](const JobRecord& job) { return job.state == JobState::kRunning; });
    std::this_thread::sleep_for(std::chrono::milliseconds(50));  // into its first chunk
    EXPECT_TRUE(engine.use_cases().PauseJob(*halted, "").ok());
    const auto next = Submit(engine, SmallScenario(3), "a");
    EXPECT_EQ(engine.WaitForEnd(*next).state, JobState::kSucceeded);
    EXPECT_TRUE(engine.use_cases().ResumeJob(*halted, "").ok());
    engine.WaitFor(*halted, [](const JobRecord& job) { return job.state == JobState::kRunning; });
  }  // and the engine stops beside it
  Engine again(database, {.threads = 1}, false);
  EXPECT_TRUE(std::ranges::all_of(*again.store().ListUnfinishedJobs(),
                                  [](const JobRecord& job) { return job.completed_iterations() == 0; }));
}

void ExpectLimit(const absl::Status& status, const std::string& option, std::int64_t value) {
  EXPECT_TRUE(absl::IsResourceExhausted(status)) << status;
  EXPECT_EQ(ReasonOf(status), "LIMIT_EXCEEDED");
  const auto limit = LimitOf(status);
  ASSERT_TRUE(limit) << status;
  EXPECT_EQ(limit->option, option);
  EXPECT_EQ(limit->value, value);
  EXPECT_THAT(std::string(status.message()), HasSubstr("at most " + std::to_string(value)));
}

TEST_F(FairShareTest, AClientMayHaveSoManyUnfinishedJobs) {
  Engine engine(NewDatabase(), {.threads = 1, .max_running_jobs = 1, .limits = {.max_jobs_per_client = 3}});
  std::vector<std::string> ids;
  for (int i = 0; i < 3; ++i) ids.push_back(*Submit(engine, EndlessScenario(), "a"));
  ExpectLimit(Submit(engine, SmallScenario(), "a").status(), "max-jobs-per-client", 3);
  EXPECT_TRUE(Submit(engine, SmallScenario(1), "b").ok());
  ASSERT_TRUE(engine.use_cases().PauseJob(ids[2], "").ok());
  ExpectLimit(Submit(engine, SmallScenario(), "a").status(), "max-jobs-per-client", 3);
  ASSERT_TRUE(engine.use_cases().CancelJob(ids[2], "").ok());
  EXPECT_TRUE(Submit(engine, SmallScenario(), "a").ok());
}

TEST_F(FairShareTest, SoManyJobsMayWaitAndHalfOfThemOneClients) {
  Engine engine(NewDatabase(), {.threads = 1, .max_running_jobs = 1, .limits = {.max_queued_jobs = 4}});
  for (int i = 0; i < 2; ++i) ASSERT_TRUE(Submit(engine, EndlessScenario(), "a").ok());  // one runs, one waits
  ExpectLimit(Submit(engine, EndlessScenario(), "a").status(), "max-queued-jobs", 4);
  ASSERT_TRUE(Submit(engine, EndlessScenario(), "b").ok());
  ASSERT_TRUE(Submit(engine, EndlessScenario(), "b").ok());
  for (const char* client : {"c", "d"}) {
    ASSERT_TRUE(Submit(engine, EndlessScenario(), client).ok()) << client;
  }
  ExpectLimit(Submit(engine, EndlessScenario(), "e").status(), "max-queued-jobs", 4);
}

TEST_F(FairShareTest, UnfinishedJobsMayTakeSoMuchMemory) {
  Engine engine(NewDatabase(), {.threads = 1, .max_running_jobs = 1, .limits = {.max_job_memory_bytes = 1 << 20}});
  Scenario scenario = EndlessScenario();
  NewJob large = JobOf(scenario);
  large.initial_conditions.assign(1000, scenario.chaser);
  large.peer = "a";
  absl::Status refused;
  for (int i = 0; i < 100 && refused.ok(); ++i) refused = engine.use_cases().CreateJob(large, "", false).status();
  ExpectLimit(refused, "max-job-memory-mib", 1);
  EXPECT_TRUE(Submit(engine, SmallScenario(), "b").ok());
}

TEST_F(FairShareTest, RoomIsGivenBack) {
  Engine engine(NewDatabase(), {.threads = 1, .limits = {.max_jobs_per_client = 2}}, false);
  JobSpec spec = SpecOf(SmallScenario());
  spec.owner = "a";
  {
    const auto room = engine.scheduler().Reserve(spec, 2);
    ASSERT_TRUE(room.ok());
    ExpectLimit(engine.scheduler().Reserve(spec, 1).status(), "max-jobs-per-client", 2);
  }
  EXPECT_TRUE(engine.scheduler().Reserve(spec, 2).ok());
}

TEST_F(FairShareTest, APriorityOutOfRangeIsRefused) {
  Engine engine(NewDatabase());
  const auto refused = Submit(engine, SmallScenario(), "a", 5);
  EXPECT_EQ(ViolatedFields(refused.status()), (std::vector<std::string>{"job.priority"}));
  EXPECT_THAT(std::string(refused.status().message()), HasSubstr("must be in [-4, 4], got 5"));
}

}  // namespace
}  // namespace orbitune::server_test
