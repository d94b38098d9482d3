// Jobs of every algorithm, over one initial condition and over several: the same bits whatever happens to them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "core/scenario/presets.h"
#include "core/search/ensemble_search.h"
#include "storage/serialise.h"
#include "storage/sqlite_schema.h"
#include "tests/server/engine_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::HasSubstr;

// Chasers about the scenario's own.
std::vector<OrbitState> Neighbours(int count) {
  const auto states =
      DrawMany(FindPreset("leo-rendezvous")->neighbourhood, 5, DrawSet::kTuning, 0, static_cast<std::uint32_t>(count));
  return *states;
}

NewJob RobustJob(Algorithm algorithm, int initial_conditions = 3) {
  NewJob job = JobOf(SmallWith(algorithm, 12));
  job.initial_conditions = Neighbours(initial_conditions);
  job.objective = {.aggregate = Aggregate::kCvar, .level = 0.5, .relative_to_initial = true};
  return job;
}

// What the search gives with no server around it.
std::vector<IterationRecord> PlainHistoryOf(const JobSpec& spec) {
  std::vector<PreparedScenario> prepared;
  for (const OrbitState& start : spec.starts()) prepared.push_back(*Prepare(spec.scenario, start));
  EnsembleSearch search(spec.scenario.search, spec.objective, prepared.size());
  std::vector<IterationRecord> history;
  while (!search.done()) {
    std::vector<EpisodeResult> results;
    for (std::size_t e = 0; e < search.episodes(); ++e) {
      results.push_back(SimulateAlone(prepared[search.initial_condition(e)], search.gains(e)));
    }
    const auto record = search.Update(results);
    EXPECT_TRUE(record.ok()) << record.status();
    history.push_back(*record);
  }
  return history;
}

class SearchJobsTest : public ::testing::Test {
 protected:
  std::string NewDatabase() { return directory_.File(std::to_string(++databases_) + ".db"); }

 private:
  TemporaryDirectory directory_;
  int databases_ = 0;
};

TEST_F(SearchJobsTest, TheNumberOfThreadsDoesNotShow) {
  for (const NewJob& job : {JobOf(SmallWith(Algorithm::kCmaEs)), JobOf(SmallWith(Algorithm::kNelderMead)),
                            RobustJob(Algorithm::kArs), RobustJob(Algorithm::kCmaEs)}) {
    for (const int threads : {1, 3}) {
      Engine engine(NewDatabase(), {.threads = threads});
      const std::string id = engine.Create(job);
      const JobRecord ended = engine.WaitForEnd(id);
      ASSERT_EQ(ended.state, JobState::kSucceeded) << ended.error_message;
      ExpectSameHistory(engine.History(id), PlainHistoryOf(ended.spec));
      EXPECT_TRUE(ended.checkpoint.empty());
      EXPECT_EQ(ended.report->episodes, ended.latest->episodes);
    }
  }
}

// Engines that end, each where it happens to be, and the pauses of one.
TEST_F(SearchJobsTest, ABrokenRunEndsAsAnUnbrokenOne) {
  for (const NewJob& job : {JobOf(SmallWith(Algorithm::kCmaEs, 60)), JobOf(SmallWith(Algorithm::kNelderMead, 60)),
                            RobustJob(Algorithm::kCmaEs), RobustJob(Algorithm::kArs)}) {
    const std::string database = NewDatabase();
    std::string id;
    {
      Engine engine(database, {.threads = 1});
      id = engine.Create(job);
      engine.WaitForIterations(id, 2);
    }
    for (int completed = 4; completed < 12; completed += 3) {
      Engine engine(database);
      engine.WaitForIterations(id, completed);
      if (engine.use_cases().PauseJob(id, "").ok()) {
        ASSERT_TRUE(engine.use_cases().ResumeJob(id, "").ok());
      }
    }
    Engine engine(database);
    const JobRecord ended = engine.WaitForEnd(id);
    ASSERT_EQ(ended.state, JobState::kSucceeded) << ended.error_message;
    ExpectSameHistory(engine.History(id), PlainHistoryOf(ended.spec));
    ExpectWellFormed(engine.Events(id));
  }
}

TEST_F(SearchJobsTest, ADamagedCheckpointFailsTheJobAndSaysSo) {
  const std::string database = NewDatabase();
  Scenario scenario = SmallWith(Algorithm::kCmaEs);
  {
    Engine engine(database, {.threads = 1}, false);
    StoreJob(engine.store(), "a", SpecOf(scenario));
    StoreRunningJob(engine.store(), "b", SpecOf(scenario), {PlainHistoryOf(SpecOf(scenario)).front()});
  }
  Engine engine(database);  // b has an iteration and no checkpoint
  EXPECT_EQ(engine.WaitForEnd("a").state, JobState::kSucceeded);
  const JobRecord ended = engine.WaitForEnd("b");
  EXPECT_EQ(ended.state, JobState::kFailed);
  EXPECT_THAT(ended.error_message, HasSubstr("checkpoint"));
}

TEST_F(SearchJobsTest, BudgetAndPlateauEndAJobThatSucceeds) {
  Engine engine(NewDatabase());
  NewJob job = JobOf(SmallWith(Algorithm::kCmaEs, 1000));
  job.search.max_episodes = 100;
  EXPECT_EQ(engine.WaitForEnd(engine.Create(job)).report->episodes, 1 + 16 * 6);
  job = JobOf(SmallScenario(1000));
  job.search.plateau_iterations = 3;
  job.search.plateau_min_improvement = 0.9;
  const JobRecord ended = engine.WaitForEnd(engine.Create(job));
  EXPECT_EQ(ended.state, JobState::kSucceeded);
  EXPECT_EQ(ended.completed_iterations(), 4);
}

TEST_F(SearchJobsTest, OtherAlgorithmsHaveABudgetOfTheirOwn) {
  Engine engine(NewDatabase());
  const auto budget = [&](const NewJob& job) {
    return engine.use_cases().CreateJob(job, "", true)->spec.scenario.search.max_episodes;
  };
  EXPECT_EQ(budget(JobOf(SmallScenario())), 0);
  EXPECT_EQ(budget(JobOf(SmallWith(Algorithm::kNelderMead))), 6000);
  EXPECT_EQ(budget(RobustJob(Algorithm::kCmaEs, 7)), 42'000);
}

TEST_F(SearchJobsTest, TheReportOfARobustJobIsOverItsInitialConditions) {
  Engine engine(NewDatabase());
  const JobRecord ended = engine.WaitForEnd(engine.Create(RobustJob(Algorithm::kCmaEs)));
  ASSERT_EQ(ended.state, JobState::kSucceeded) << ended.error_message;
  const GainsAssessment& best = ended.report->best;
  ASSERT_TRUE(best.ensemble);
  std::vector<double> costs, reductions, samples;
  int settled = 0;
  for (const OrbitState& start : ended.spec.initial_conditions) {
    const PreparedScenario prepared = *Prepare(ended.spec.scenario, start);
    const EpisodeResult result = SimulateAlone(prepared, best.gains);
    costs.push_back(result.cost);
    if (result.outcome == Outcome::kSettled) ++settled;
    samples.push_back(result.settling_samples);
    reductions.push_back(100 * (1 - result.cost / SimulateAlone(prepared, ended.report->initial.gains).cost));
  }
  const auto mean = [](const std::vector<double>& v) { return std::accumulate(v.begin(), v.end(), 0.0) / 3; };
  EXPECT_EQ(best.ensemble->initial_conditions, 3);
  EXPECT_EQ(best.ensemble->settled, settled);
  EXPECT_EQ(best.ensemble->objective, ended.best->cost);
  EXPECT_NEAR(best.ensemble->cost.mean / mean(costs), 1, 1e-4);
  EXPECT_NEAR(best.ensemble->cost.max / std::ranges::max(costs), 1, 1e-4);
  EXPECT_NEAR(best.ensemble->cost_reduction_percent.mean, mean(reductions), 1e-2);
  EXPECT_NEAR(best.ensemble->cost_reduction_percent.min, std::ranges::min(reductions), 1e-2);
  EXPECT_EQ(best.episode.cost, best.ensemble->cost.mean);
  EXPECT_EQ(best.episode.settling_samples, std::lround(mean(samples)));
  // CVaR at 0.5 of three relative costs: the worst and half of the next.
  std::ranges::sort(reductions);
  const double cvar = ((1 - reductions[0] / 100) + 0.5 * (1 - reductions[1] / 100)) / 1.5;
  EXPECT_NEAR(ended.best->cost / cvar, 1, 1e-4);
  EXPECT_DOUBLE_EQ(ended.first->cost, 1);
}

TEST_F(SearchJobsTest, AnInitialConditionThatLeavesTheDomainUnderEveryGainFailsTheJob) {
  Engine engine(NewDatabase());
  NewJob job;
  job.scenario.preset_id = "gto-geo";
  job.initial_conditions = {FindPreset("gto-geo")->chaser, FindPreset("gto-geo-printed")->chaser};
  const JobRecord ended = engine.WaitForEnd(engine.Create(job));
  EXPECT_EQ(ended.state, JobState::kFailed);
  EXPECT_THAT(ended.error_message, HasSubstr("from initial condition 1, left the domain"));
}

TEST_F(SearchJobsTest, AWarmStartBeginsWithTheBestGainsOfAnother) {
  Engine engine(NewDatabase());
  const std::string source = engine.Create(SmallScenario());
  const Gains best = engine.WaitForEnd(source).best->gains;
  NewJob job = JobOf(SmallWith(Algorithm::kCmaEs));
  job.warm_start = "jobs/" + source;
  JobRecord started = *engine.use_cases().CreateJob(job, "", true);
  EXPECT_EQ(started.spec.scenario.search.initial_gains, best);
  EXPECT_EQ(started.spec.warm_start, job.warm_start);
  job.search.gain_floor = 0.5;
  started = *engine.use_cases().CreateJob(job, "", true);
  for (std::size_t i = 0; i < kGainCount; ++i) {
    EXPECT_EQ(started.spec.scenario.search.initial_gains[i], std::max(best[i], 0.5));
  }
}

TEST_F(SearchJobsTest, AWarmStartFromAGainSetGoesThroughItsSource) {
  Engine engine(NewDatabase());
  const PreparedScenario prepared = *Prepare(SmallScenario());
  const WarmStart known{{1, 2, 3, 4, 5}, prepared.velocity_unit_m_s, prepared.acceleration_unit_m_s2};
  engine.use_cases().set_gain_sets([&](const std::string& id) -> absl::StatusOr<WarmStart> {
    if (id == "known") return known;
    return absl::NotFoundError("no such gain set");
  });
  NewJob job = JobOf(SmallScenario());
  job.warm_start = "gainSets/known";
  EXPECT_EQ(engine.use_cases().CreateJob(job, "", true)->spec.scenario.search.initial_gains, known.gains);
  job.warm_start = "gainSets/none";
  EXPECT_EQ(ViolatedFields(engine.use_cases().CreateJob(job, "", true).status()).size(), 1u);
}

TEST_F(SearchJobsTest, AWarmStartThatIsNoneIsRefusedNamingWhatItMustBe) {
  Engine engine(NewDatabase());
  const std::string running = engine.Create(EndlessScenario());
  const std::string ended = engine.Create(SmallScenario(2));
  engine.WaitForEnd(ended);
  const auto message = [&](const std::string& name, const std::function<void(NewJob&)>& change = {}) {
    NewJob job = JobOf(SmallScenario());
    job.warm_start = name;
    if (change) change(job);
    return std::string(engine.use_cases().CreateJob(job, "", true).status().message());
  };
  EXPECT_THAT(message("nonsense"), HasSubstr("job.warm_start: must be jobs/ID or gainSets/ID"));
  EXPECT_THAT(message("gainSets/a"), HasSubstr("job.warm_start: must be the name of a gain set that there is"));
  EXPECT_THAT(message("jobs/none"), HasSubstr("a job that there is"));
  EXPECT_THAT(message("jobs/" + running), HasSubstr("a job that has ended"));
  EXPECT_THAT(message("jobs/" + ended,
                      [](NewJob& job) {
                        job.search.initial_gains = Gains{1, 1, 1, 1, 1};
                      }),
              HasSubstr("job.warm_start: must be empty where initial_gains are given"));
  EXPECT_THAT(message("jobs/" + ended, [](NewJob& job) { job.scenario.definition->acceleration_unit_m_s2 = 2; }),
              HasSubstr("job.warm_start: must be gains in units of"));
}

TEST_F(SearchJobsTest, EveryFaultOfARobustJobIsToldAtOnce) {
  Engine engine(NewDatabase());
  const auto faults = [&](const std::function<void(NewJob&)>& change) {
    NewJob job = RobustJob(Algorithm::kCmaEs);
    change(job);
    return ViolatedFields(engine.use_cases().CreateJob(job, "", true).status());
  };
  using Fields = std::vector<std::string>;
  EXPECT_EQ(faults([](NewJob& job) {
              job.objective.level = 1;
              job.search.population = 2;
              job.initial_conditions[1] = EquinoctialState{.p_km = -1};
            }),
            (Fields{"job.objective.level", "job.hyperparameters.cma_es.population",
                    "job.initial_conditions[1].equinoctial.p_km"}));
  EXPECT_EQ(faults([](NewJob& job) { job.initial_condition = job.initial_conditions[0]; }),
            Fields{"job.initial_conditions"});
  EXPECT_EQ(faults([](NewJob& job) { job.initial_conditions.clear(); }), Fields{"job.objective"});
  EXPECT_EQ(faults([](NewJob& job) { job.initial_conditions[2] = std::monostate(); }),
            Fields{"job.initial_conditions[2]"});
  EXPECT_EQ(faults([](NewJob& job) { job.initial_conditions.resize(1001, job.initial_conditions[0]); }),
            Fields{"job.initial_conditions"});
  EXPECT_EQ(faults([](NewJob& job) { job.search.max_episodes = 20; }), Fields{"job.hyperparameters.max_episodes"});
}

// A database of schema version 1 with a job in the middle of its run, as its server wrote it.
TEST_F(SearchJobsTest, AJobOfSchemaVersion1IsTakenUp) {
  const std::string database = NewDatabase();
  const Scenario scenario = SmallScenario();
  const auto whole = PlainHistory(scenario);
  {
    auto connection = Connection::Open(database, Connection::Mode::kReadWrite);
    ASSERT_TRUE(connection.ok());
    ASSERT_TRUE(Migrate(**connection, Migrations().first(1)).ok());
    ASSERT_TRUE((*connection)
                    ->Run("INSERT INTO jobs VALUES (1, 'old', 'RUNNING', 'small', 5, 6, NULL, 6, 5, 2, 3, ?, ?, NULL, "
                          "NULL, '')",
                          whole[2].iteration, whole[2].cost)
                    .ok());
    ASSERT_TRUE((*connection)->Run("INSERT INTO job_documents VALUES (1, ?, NULL)", *ToJson(SpecOf(scenario))).ok());
    ASSERT_TRUE(
        (*connection)->Execute("INSERT INTO job_events VALUES (1, 1, 'QUEUED', 5, ''), (1, 2, 'RUNNING', 6, '')").ok());
    for (const IterationRecord& r : std::span(whole).first(3)) {
      const Gains& k = r.gains;
      ASSERT_TRUE((*connection)
                      ->Run("INSERT INTO iterations VALUES (1, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", r.iteration,
                            k[0], k[1], k[2], k[3], k[4], r.cost, r.settling_samples, r.fuel_sum,
                            static_cast<int>(r.outcome), r.cost_std, r.pairs_left_out, r.pairs_not_settled)
                      .ok());
    }
  }
  Engine engine(database);
  const JobRecord ended = engine.WaitForEnd("old");
  EXPECT_EQ(ended.state, JobState::kSucceeded) << ended.error_message;
  ExpectSameHistory(engine.History("old"), whole);
  EXPECT_EQ(ended.provenance->backfilled, 3);
}

}  // namespace
}  // namespace orbitune::server_test
