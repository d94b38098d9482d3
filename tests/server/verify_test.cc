// Verification of jobs' histories: true ones of every algorithm and in every state, and all kinds of altered ones.
#include "server/jobs/verify.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/library/history_digest.h"
#include "core/scenario/presets.h"
#include "core/simd/lane_kernel.h"
#include "storage/sqlite_connection.h"
#include "tests/server/engine_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

NewJob RobustJob(bool relative) {
  NewJob job = JobOf(SmallWith(Algorithm::kArs, 8));
  job.initial_conditions = *DrawMany(FindPreset("leo-rendezvous")->neighbourhood, 5, DrawSet::kTuning, 0, 3);
  job.objective = {.aggregate = Aggregate::kWorst, .relative_to_initial = relative};
  return job;
}

Verification Verify(Engine& engine, const std::string& id, VerifyRange range = {}) {
  auto result = VerifyJob(engine.store(), id, range, [](const VerifyProgress&) { return true; });
  EXPECT_TRUE(result.ok()) << result.status();
  return result.ok() ? *std::move(result) : Verification{};
}

Digest DigestOf(const JobSpec& spec, const std::vector<IterationRecord>& history, const std::string& scenario_digest) {
  Digest digest = Sha256(
      InputsText(scenario_digest, spec.scenario, spec.initial_condition, spec.initial_conditions, spec.objective));
  for (const IterationRecord& record : history) digest = ExtendHistory(digest, record);
  return digest;
}

class VerifyTest : public ::testing::Test {
 protected:
  std::string Database() const { return directory_.File("orbitune.db"); }

  // A job that has ended, its server gone.
  std::string Run(const NewJob& job) {
    Engine engine(Database());
    const std::string id = engine.Create(job);
    const JobRecord ended = engine.WaitForEnd(id);
    EXPECT_EQ(ended.state, JobState::kSucceeded) << ended.error_message;
    digest_ = ended.provenance->digest;
    return id;
  }

  // What somebody does to the file while no server has it.
  void Alter(const std::string& sql) {
    auto connection = Connection::Open(Database(), Connection::Mode::kReadWrite);
    ASSERT_TRUE(connection.ok());
    const absl::Status status = (*connection)->Execute(sql);
    ASSERT_TRUE(status.ok()) << status;
  }

  Verification VerifyAgain(const std::string& id, VerifyRange range = {}) {
    Engine engine(Database(), {.threads = 1}, false);
    return Verify(engine, id, range);
  }

  Digest digest_{};

 private:
  TemporaryDirectory directory_;
};

TEST_F(VerifyTest, EveryAlgorithmsHistoryIsIdentical) {
  Scenario plateau = SmallScenario(12);
  plateau.search.plateau_stop.iterations = 4;
  Engine engine(Database());
  for (const NewJob& job :
       {JobOf(SmallScenario(12)), JobOf(SmallWith(Algorithm::kCmaEs, 12)), JobOf(SmallWith(Algorithm::kNelderMead, 12)),
        RobustJob(false), RobustJob(true), JobOf(plateau), JobOf(EdgeScenario(6))}) {
    const std::string id = engine.Create(job);
    const JobRecord ended = engine.WaitForEnd(id);
    ASSERT_EQ(ended.state, JobState::kSucceeded) << ended.error_message;
    const Verification result = Verify(engine, id);
    EXPECT_EQ(result.verdict, Verdict::kIdentical) << result.conclusion;
    EXPECT_EQ(result.first_iteration, 1);
    EXPECT_EQ(result.last_iteration, ended.completed_iterations());
    EXPECT_FALSE(result.first_difference);
    EXPECT_TRUE(result.engine_differences.empty());
    EXPECT_EQ(result.digest, ended.provenance->digest);
    EXPECT_EQ(result.recorded_digest, ended.provenance->digest);
    EXPECT_EQ(result.digest, DigestOf(ended.spec, engine.History(id), ended.provenance->scenario_digest));
  }
}

// ARS begins just before the range; what has a memory, at the beginning.
TEST_F(VerifyTest, ARangeStartsWhereTheSearchCan) {
  Scenario plateau = SmallScenario(12);
  plateau.search.plateau_stop.iterations = 100;
  Engine engine(Database());
  const auto first_of = [&](const NewJob& job, VerifyRange range) {
    const std::string id = engine.Create(job);
    engine.WaitForEnd(id);
    const Verification result = Verify(engine, id, range);
    EXPECT_EQ(result.verdict, Verdict::kIdentical) << result.conclusion;
    EXPECT_EQ(result.last_iteration, range.last);
    return result.first_iteration;
  };
  EXPECT_EQ(first_of(JobOf(SmallScenario(12)), {.first = 7, .last = 9}), 6);
  EXPECT_EQ(first_of(JobOf(SmallScenario(12)), {.first = 12, .last = 12}), 11);
  EXPECT_EQ(first_of(JobOf(SmallScenario(12)), {.first = 1, .last = 3}), 1);
  EXPECT_EQ(first_of(RobustJob(false), {.first = 5, .last = 6}), 4);
  EXPECT_EQ(first_of(RobustJob(true), {.first = 5, .last = 6}), 1);
  EXPECT_EQ(first_of(JobOf(plateau), {.first = 7, .last = 9}), 1);
  EXPECT_EQ(first_of(JobOf(SmallWith(Algorithm::kCmaEs, 12)), {.first = 7, .last = 9}), 1);
  EXPECT_EQ(first_of(JobOf(SmallWith(Algorithm::kNelderMead, 12)), {.first = 7, .last = 9}), 1);
}

TEST_F(VerifyTest, TheDigestIsThatOfTheInputsWhateverHappensToTheJob) {
  const Scenario scenario = SmallScenario(300);
  Digest unbroken{};
  {
    TemporaryDirectory other;
    Engine engine(other.File("orbitune.db"), {.threads = 1});
    const std::string id = engine.Create(scenario);
    unbroken = engine.WaitForEnd(id).provenance->digest;
  }
  std::string id;
  {
    Engine engine(Database(), {.threads = 2});
    id = engine.Create(scenario);
    engine.WaitForIterations(id, 2);
  }
  for (const std::string& target : simd::SupportedTargets()) {
    if (target == "baseline") continue;  // which has other bits
    ASSERT_TRUE(simd::UseTarget(target));
    Engine engine(Database());
    engine.WaitForIterations(id, engine.Get(id).completed_iterations() + 3);
    if (engine.use_cases().PauseJob(id, "").ok()) {
      ASSERT_TRUE(engine.use_cases().ResumeJob(id, "").ok());
    }
  }
  ASSERT_TRUE(simd::UseTarget("auto"));
  Engine engine(Database());
  const JobRecord ended = engine.WaitForEnd(id);
  ASSERT_EQ(ended.state, JobState::kSucceeded) << ended.error_message;
  EXPECT_EQ(ended.provenance->digest, unbroken);
  EXPECT_EQ(ended.provenance->backfilled, 0);
  EXPECT_EQ(ended.provenance->engines.front().first_iteration, 1);
  EXPECT_EQ(Verify(engine, id).verdict, Verdict::kIdentical);
}

TEST_F(VerifyTest, OtherInputsHaveAnotherDigest) {
  Scenario scenario = SmallScenario(2);
  Engine engine(Database());
  const auto digest_of = [&] { return engine.WaitForEnd(engine.Create(scenario)).provenance->digest; };
  const Digest digest = digest_of();
  EXPECT_EQ(digest_of(), digest);
  scenario.search.seed += 1;
  EXPECT_NE(digest_of(), digest);
}

TEST_F(VerifyTest, WhatTheGainSetComesFromIsToldWithIt) {
  Engine engine(Database());
  const std::string id = engine.Create(SmallScenario(3));
  const JobRecord ended = engine.WaitForEnd(id);
  EXPECT_EQ(engine.store().gains().GetGainSet(id)->history_digest, ToHex(ended.provenance->digest));
}

TEST_F(VerifyTest, AJobInAnyStateIsVerifiedAsFarAsItIs) {
  Engine engine(Database());
  const std::string id = engine.Create(EndlessScenario());
  engine.WaitForIterations(id, 5);
  const Verification running = Verify(engine, id, {.first = 1, .last = 5});
  EXPECT_EQ(running.verdict, Verdict::kIdentical) << running.conclusion;
  ASSERT_TRUE(engine.use_cases().PauseJob(id, "").ok());
  EXPECT_EQ(Verify(engine, id, {.last = 4}).verdict, Verdict::kIdentical);
  ASSERT_TRUE(engine.use_cases().CancelJob(id, "").ok());
  EXPECT_EQ(Verify(engine, id, {.first = 3, .last = 5}).verdict, Verdict::kIdentical);
}

// Where the processor has both kinds.
TEST_F(VerifyTest, AnotherKindOfEngineIsSaidToExplainIt) {
  if (simd::SupportedTargets().front() == "baseline") GTEST_SKIP();
  ASSERT_TRUE(simd::UseTarget("baseline"));
  const std::string id = Run(JobOf(SmallScenario(30)));
  ASSERT_TRUE(simd::UseTarget("auto"));
  const Verification result = VerifyAgain(id);
  EXPECT_EQ(result.verdict, Verdict::kDifferent);
  EXPECT_THAT(result.engine_differences, ElementsAre(HasSubstr("multiply and add: not fused (baseline) then, fused")));
  EXPECT_THAT(result.conclusion, HasSubstr("another engine, which may explain it"));
  EXPECT_EQ(result.digest, digest_);
}

TEST_F(VerifyTest, AnAlteredIterationIsFoundAndSoIsWhatItWas) {
  const std::string id = Run(JobOf(SmallScenario(12)));
  Alter("UPDATE iterations SET cost = cost + 1e-9 WHERE iteration = 7");
  const Verification result = VerifyAgain(id);
  EXPECT_EQ(result.verdict, Verdict::kAltered);
  ASSERT_TRUE(result.first_difference);
  EXPECT_EQ(result.first_difference->iteration, 7);
  EXPECT_EQ(result.first_difference->stored->cost, result.first_difference->recomputed->cost + 1e-9);
  EXPECT_EQ(result.recorded_digest, digest_);
  EXPECT_NE(result.digest, digest_);
  EXPECT_THAT(result.conclusion, HasSubstr("it is the iterations that were altered"));
  // The digest is of all iterations, whichever are run again.
  EXPECT_EQ(VerifyAgain(id, {.first = 9, .last = 12}).verdict, Verdict::kAltered);
}

// The digest says nothing of what is not in it; running the job again does.
TEST_F(VerifyTest, AnIterationIsComparedInAllItHas) {
  const std::string id = Run(JobOf(SmallScenario(12)));
  Alter("UPDATE iterations SET settling_samples = settling_samples + 1 WHERE iteration = 3");
  const Verification result = VerifyAgain(id);
  EXPECT_EQ(result.verdict, Verdict::kDifferent);
  EXPECT_EQ(result.first_difference->iteration, 3);
  EXPECT_EQ(result.digest, digest_);
}

TEST_F(VerifyTest, AnAlteredDigestIsFound) {
  const std::string id = Run(JobOf(SmallScenario(5)));
  Alter(absl::StrCat("UPDATE jobs SET digest = '", std::string(64, 'a'), "'"));
  const Verification result = VerifyAgain(id);
  EXPECT_EQ(result.verdict, Verdict::kAltered);
  EXPECT_FALSE(result.first_difference);
  EXPECT_EQ(result.digest, digest_);
}

// All that a job says of itself, made to fit.
TEST_F(VerifyTest, AForgedHistoryThatFitsItsDigestIsFoundByRunningItAgain) {
  const std::string id = Run(JobOf(SmallScenario(6)));
  Alter("UPDATE iterations SET k1 = k1 * 1.5 WHERE iteration = 4");
  Digest forged{};
  {
    Engine engine(Database(), {.threads = 1}, false);
    const JobRecord job = engine.Get(id);
    forged = DigestOf(job.spec, engine.History(id), job.provenance->scenario_digest);
  }
  Alter(absl::StrCat("UPDATE jobs SET digest = '", ToHex(forged), "'"));
  const Verification result = VerifyAgain(id);
  EXPECT_EQ(result.verdict, Verdict::kDifferent);
  EXPECT_EQ(result.first_difference->iteration, 4);
  EXPECT_EQ(VerifyAgain(id, {.first = 4, .last = 4}).verdict, Verdict::kDifferent);
}

TEST_F(VerifyTest, AlteredInputsAreFound) {
  const std::string id = Run(JobOf(SmallScenario(5)));
  Alter("UPDATE job_documents SET spec = json_set(spec, '$.scenario.search.seed', 99)");
  const Verification result = VerifyAgain(id);
  EXPECT_EQ(result.verdict, Verdict::kAltered);
  EXPECT_THAT(result.conclusion, HasSubstr("inputs are not those"));
}

TEST_F(VerifyTest, AHistoryThatWasCutOffIsFound) {
  const std::string id = Run(JobOf(SmallScenario(6)));
  Alter("DELETE FROM iterations WHERE iteration = 6; UPDATE jobs SET iterations = 5, best_iteration = 1");
  const Verification result = VerifyAgain(id);
  EXPECT_EQ(result.verdict, Verdict::kAltered);
  ASSERT_TRUE(result.first_difference);
  EXPECT_EQ(result.first_difference->iteration, 6);
  EXPECT_FALSE(result.first_difference->stored);
  EXPECT_TRUE(result.first_difference->recomputed);
  EXPECT_THAT(result.conclusion, HasSubstr("the search goes on after iteration 5"));
}

TEST_F(VerifyTest, AMissingIterationIsDataLoss) {
  const std::string id = Run(JobOf(SmallScenario(6)));
  Alter("DELETE FROM iterations WHERE iteration = 4");
  Engine engine(Database(), {.threads = 1}, false);
  const auto result = VerifyJob(engine.store(), id, {}, [](const VerifyProgress&) { return true; });
  EXPECT_TRUE(absl::IsDataLoss(result.status())) << result.status();
}

TEST_F(VerifyTest, AJobWithoutADigestIsRunAgainAllTheSame) {
  const std::string id = Run(JobOf(SmallScenario(5)));
  Alter("UPDATE jobs SET digest = NULL; UPDATE job_documents SET provenance = NULL");
  const Verification result = VerifyAgain(id);
  EXPECT_EQ(result.verdict, Verdict::kIdentical);
  EXPECT_EQ(result.digest, digest_);
  EXPECT_FALSE(result.recorded_digest);
  EXPECT_THAT(result.conclusion, HasSubstr("kept no digest"));
}

// As a server that knew no digests left it.
TEST_F(VerifyTest, AJobThatIsTakenUpAfterAnUpgradeSaysFromWhereItsDigestIsFirstHand) {
  const std::string id = "old";
  {
    Engine engine(Database(), {.threads = 1}, false);
    StoreRunningJob(engine.store(), id, SpecOf(SmallScenario(9)), PlainHistory(SmallScenario(3)));
  }
  Alter("UPDATE jobs SET digest = NULL; UPDATE job_documents SET provenance = NULL");
  Engine engine(Database());
  const JobRecord ended = engine.WaitForEnd(id);
  ASSERT_EQ(ended.state, JobState::kSucceeded) << ended.error_message;
  EXPECT_EQ(ended.provenance->backfilled, 3);
  ASSERT_EQ(ended.provenance->engines.size(), 1u);
  EXPECT_EQ(ended.provenance->engines[0].first_iteration, 4);
  const Verification result = Verify(engine, id);
  EXPECT_EQ(result.verdict, Verdict::kIdentical) << result.conclusion;
  EXPECT_EQ(result.recorded_digest, DigestOf(ended.spec, engine.History(id), ended.provenance->scenario_digest));
  EXPECT_THAT(result.conclusion, HasSubstr("up to iteration 3 the digest was made after the event"));
}

TEST_F(VerifyTest, AJobWhoseIterationsWereRemovedIsHeldAgainstItsDigest) {
  const std::string id = Run(JobOf(SmallScenario(12)));
  {
    Engine engine(Database(), {.threads = 1}, false);
    engine.store().retention().RemoveIterations(id, NowUs(),
                                                [](const absl::Status& status) { EXPECT_TRUE(status.ok()) << status; });
    engine.store().Flush();
    const Verification result = Verify(engine, id);
    EXPECT_EQ(result.verdict, Verdict::kIdentical) << result.conclusion;
    EXPECT_EQ(result.digest, digest_);
    EXPECT_EQ(result.recorded_digest, digest_);
    EXPECT_THAT(result.conclusion, HasSubstr("its iterations were removed"));
    const auto stretch = VerifyJob(engine.store(), id, {.first = 3}, [](const VerifyProgress&) { return true; });
    EXPECT_EQ(ReasonOf(stretch.status()), "ITERATIONS_REMOVED");
  }
  Alter("UPDATE iterations SET cost = cost * 2 WHERE iteration = 12");
  const Verification last = VerifyAgain(id);
  EXPECT_EQ(last.verdict, Verdict::kDifferent);
  EXPECT_EQ(last.first_difference->iteration, 12);
  EXPECT_EQ(last.digest, digest_);
  Alter("UPDATE iterations SET cost = cost / 2 WHERE iteration = 12");
  Alter(absl::StrCat("UPDATE jobs SET digest = '", std::string(64, 'a'), "'"));
  const Verification digest = VerifyAgain(id);
  EXPECT_EQ(digest.verdict, Verdict::kDifferent);
  EXPECT_THAT(digest.conclusion, HasSubstr("another digest"));
  Alter("UPDATE jobs SET digest = NULL; UPDATE job_documents SET provenance = NULL");
  EXPECT_EQ(VerifyAgain(id).verdict, Verdict::kIdentical);
}

TEST_F(VerifyTest, SaysWhatCannotBeVerified) {
  Engine engine(Database(), {.threads = 1}, false);
  const auto error = [&](const std::string& id, VerifyRange range) {
    return VerifyJob(engine.store(), id, range, [](const VerifyProgress&) { return true; }).status();
  };
  StoreJob(engine.store(), "new", SpecOf(SmallScenario()));
  StoreRunningJob(engine.store(), "begun", SpecOf(SmallScenario()), PlainHistory(SmallScenario(2)));
  EXPECT_TRUE(absl::IsNotFound(error("none", {})));
  EXPECT_TRUE(absl::IsFailedPrecondition(error("new", {})));
  EXPECT_EQ(ReasonOf(error("new", {})), "JOB_STATE");
  using Fields = std::vector<std::string>;
  EXPECT_EQ(ViolatedFields(error("begun", {.first = 3})), Fields{"first_iteration"});
  EXPECT_EQ(ViolatedFields(error("begun", {.first = -1})), Fields{"first_iteration"});
  EXPECT_EQ(ViolatedFields(error("begun", {.first = 2, .last = 1})), Fields{"last_iteration"});
  EXPECT_EQ(ViolatedFields(error("begun", {.last = 3})), Fields{"last_iteration"});
}

TEST_F(VerifyTest, EndsWhenNobodyWantsItAnyMore) {
  Engine engine(Database());
  const std::string id = engine.Create(SmallScenario(12));
  engine.WaitForEnd(id);
  std::vector<int> seen;
  const auto result = VerifyJob(engine.store(), id, {}, [&](const VerifyProgress& progress) {
    seen.push_back(progress.iteration);
    return progress.iteration < 4;
  });
  EXPECT_TRUE(absl::IsCancelled(result.status())) << result.status();
  EXPECT_THAT(seen, ElementsAre(0, 0, 1, 2, 3, 4));
}

}  // namespace
}  // namespace orbitune::server_test
