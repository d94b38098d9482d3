#include "server/service/gain_use_cases.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <thread>

#include "core/library/scenario_digest.h"
#include "tests/server/engine_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using Source = Candidate::Source;

// A rendezvous that settles, tuned in a moment.
Scenario Rendezvous(int iterations = 3) {
  Scenario s = SmallScenario(iterations);
  s.horizon_samples = 1280;
  return s;
}

OrbitState Moved(const OrbitState& start, double longitude_deg) {
  EquinoctialState state = std::get<EquinoctialState>(start);
  state.true_longitude_deg += longitude_deg;
  return state;
}

GainQuery QueryFor(const Scenario& scenario, double longitude_deg = 0) {
  return {.scenario = {.preset_id = "", .definition = scenario},
          .initial_condition = Moved(scenario.chaser, longitude_deg)};
}

class GainUseCasesTest : public ::testing::Test {
 protected:
  // A job on this start, and its gain set in the library.
  std::string Tune(const Scenario& scenario, double longitude_deg = 0) {
    NewJob job = JobOf(scenario);
    job.display_name = "tuned";
    job.initial_condition = Moved(scenario.chaser, longitude_deg);
    const std::size_t before = LibrarySize(scenario);
    const auto created = engine_->use_cases().CreateJob(job, "", false);
    EXPECT_TRUE(created.ok()) << created.status();
    EXPECT_EQ(engine_->WaitForEnd(created->id).state, JobState::kSucceeded);
    // The library is told after the commit.
    while (LibrarySize(scenario) == before) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return created->id;
  }

  std::size_t LibrarySize(const Scenario& scenario) { return Ask(QueryFor(scenario)).result.position.library_size; }

  bool Has(const Scenario& scenario, const std::string& id) {
    const GainQueryAnswer answer = Ask(QueryFor(scenario));
    return std::ranges::any_of(answer.result.answers,
                               [&](const QueryAnswer& a) { return a.candidate.gain_set_id == id; });
  }

  GainQueryAnswer Ask(GainQuery query) {
    if (query.max_answers == 0) query.max_answers = 100;
    auto answer = engine_->gains().Query(query);
    EXPECT_TRUE(answer.ok()) << answer.status();
    return answer.ok() ? *std::move(answer) : GainQueryAnswer{};
  }

  GainSet Get(const std::string& id) {
    auto set = engine_->gains().Get(id);
    EXPECT_TRUE(set.ok()) << set.status();
    return set.ok() ? *std::move(set) : GainSet{};
  }

  std::vector<std::string> List(const std::string& filter, int page_size = 0) {
    std::vector<std::string> ids;
    std::string token;
    do {
      const auto page = engine_->gains().List(page_size, token, filter);
      EXPECT_TRUE(page.ok()) << page.status();
      if (!page.ok()) return ids;
      for (const GainSet& set : page->items) ids.push_back(set.id);
      token = page->next_page_token;
    } while (!token.empty());
    return ids;
  }

  ImportedGainSet Exported(const GainSet& set) {
    ImportedGainSet imported;
    imported.scenario.definition = set.scenario;
    imported.scenario_digest = set.scenario_digest;
    imported.velocity_unit_m_s = set.velocity_unit_m_s;
    imported.acceleration_unit_m_s2 = set.acceleration_unit_m_s2;
    imported.gains = set.gains;
    imported.initial_condition = set.initial_condition;
    imported.algorithm = set.algorithm;
    imported.seed = set.seed;
    imported.origin = "gainSets/" + set.id;
    return imported;
  }

  void Restart() {
    engine_.reset();
    engine_.emplace(directory_.File("jobs.db"));
  }

  void ExpectRefused(const absl::Status& status, const std::vector<std::string>& fields) {
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
    EXPECT_EQ(ViolatedFields(status), fields) << status;
  }

  TemporaryDirectory directory_;
  std::optional<Engine> engine_{std::in_place, directory_.File("jobs.db")};
};

TEST_F(GainUseCasesTest, AJobThatSucceedsBecomesAGainSetOfItsBestGains) {
  const Scenario scenario = Rendezvous(5);
  const std::string id = Tune(scenario, 0.05);
  const JobRecord job = engine_->Get(id);
  for (const bool restart : {false, true}) {
    if (restart) Restart();
    const GainSet set = Get(id);
    EXPECT_EQ(set.kind, GainSetKind::kTuned);
    EXPECT_EQ(set.display_name, "tuned");
    EXPECT_EQ(set.job_id, id);
    EXPECT_EQ(set.gains, job.report->best.gains);
    EXPECT_EQ(set.iteration, job.report->best.iteration);
    EXPECT_EQ(set.flight.cost, job.report->best.episode.cost);
    EXPECT_EQ(set.flight.delta_v_m_s, job.report->best.episode.delta_v_to_settling_m_s);
    EXPECT_EQ(set.flight.peak_acceleration_m_s2, job.report->best.episode.peak_acceleration_m_s2);
    EXPECT_TRUE(set.flight.certificate.gains_positive);
    EXPECT_TRUE(set.flight.certificate.domain_guaranteed);
    EXPECT_TRUE(set.flight.certificate.lyapunov_decreasing);
    EXPECT_TRUE(set.flight.certificate.settled);
    EXPECT_EQ(set.scenario_digest, ScenarioDigest(scenario));
    EXPECT_EQ(set.scenario.id, "small");
    EXPECT_EQ(set.algorithm, "ARS");
    EXPECT_EQ(set.seed, scenario.search.seed);
    EXPECT_NE(set.engine_version, "");
    EXPECT_NEAR(set.acceleration_unit_m_s2, 21.967, 1e-3);
    const auto prepared = Prepare(scenario, Moved(scenario.chaser, 0.05));
    ASSERT_TRUE(prepared.ok() && set.initial_error);
    EXPECT_EQ(set.initial_error->x1, prepared->problem.initial_error.x1);
    EXPECT_TRUE(Has(scenario, id)) << "lost by the library";
  }
}

TEST_F(GainUseCasesTest, AJobWithSeveralStartsBecomesARobustGainSet) {
  NewJob job = JobOf(Rendezvous(2));
  const OrbitState start = job.scenario.definition->chaser;
  job.initial_conditions = {start, Moved(start, 0.1), Moved(start, -0.1)};
  const auto created = engine_->use_cases().CreateJob(job, "", false);
  ASSERT_TRUE(created.ok()) << created.status();
  ASSERT_EQ(engine_->WaitForEnd(created->id).state, JobState::kSucceeded);
  const GainSet set = Get(created->id);
  EXPECT_EQ(set.kind, GainSetKind::kRobust);
  EXPECT_FALSE(set.initial_error);
  EXPECT_TRUE(std::holds_alternative<std::monostate>(set.initial_condition));
  EXPECT_TRUE(set.flight.certificate.settled);
  Restart();
  const GainQueryAnswer answer = Ask(QueryFor(Rendezvous()));
  EXPECT_EQ(answer.result.position.library_size, 1u);
  EXPECT_EQ(answer.result.position.located, 0u);
  EXPECT_EQ(answer.result.candidates, 2);
}

TEST_F(GainUseCasesTest, WithNothingStoredTheAnswerSaysSoAndOffersToTune) {
  const GainQueryAnswer answer = Ask({.scenario = {.preset_id = "leo-rendezvous"}});
  ASSERT_EQ(answer.result.answers.size(), 1u);
  EXPECT_EQ(answer.result.answers[0].candidate.source, Source::kInitial);
  EXPECT_NEAR(answer.result.answers[0].flight.cost, 313.298, 1e-3);
  EXPECT_EQ(answer.result.position.library_size, 0u);
  EXPECT_THAT(answer.message, HasSubstr("No gains are stored for scenarios/leo-rendezvous"));
  EXPECT_THAT(answer.message, HasSubstr("CreateJob"));
}

TEST_F(GainUseCasesTest, TheBestOfTheLibraryFromTheNewStart) {
  const Scenario scenario = Rendezvous(6);
  for (const double offset : {-0.1, 0.0, 0.1}) Tune(scenario, offset);
  const GainQuery query = QueryFor(scenario, 0.04);
  const GainQueryAnswer answer = Ask(query);
  EXPECT_EQ(answer.message, "");
  EXPECT_TRUE(answer.result.settled());
  EXPECT_FALSE(answer.result.position.extrapolated);
  EXPECT_EQ(answer.result.position.library_size, 3u);
  const auto prepared = Prepare(scenario, query.initial_condition);
  ASSERT_TRUE(prepared.ok());
  double before = 0;
  for (const QueryAnswer& one : answer.result.answers) {
    EXPECT_EQ(one.flight.cost, SimulateAlone(*prepared, one.candidate.gains).cost);
    EXPECT_GE(one.flight.cost, before);
    before = one.flight.cost;
  }
  EXPECT_LT(answer.result.answers.front().flight.cost, before);
}

TEST_F(GainUseCasesTest, FarAwayIsExtrapolated) {
  const Scenario scenario = Rendezvous();
  for (const double offset : {-0.1, 0.0, 0.1}) Tune(scenario, offset);
  const GainQueryAnswer answer = Ask(QueryFor(scenario, 3));
  EXPECT_TRUE(answer.result.position.extrapolated);
  EXPECT_THAT(answer.message, HasSubstr("outside of the library"));
}

TEST_F(GainUseCasesTest, AnotherScenariosUnitsAreToldAndNotUsed) {
  const Scenario scenario = Rendezvous();
  Tune(scenario);
  Scenario other = scenario;
  other.acceleration_unit_m_s2 = 1;
  const GainQueryAnswer answer = Ask(QueryFor(other));
  EXPECT_EQ(answer.result.position.library_size, 0u);
  EXPECT_THAT(answer.message, HasSubstr("acceleration_unit_m_s2: 21.96"));
  EXPECT_THAT(answer.message, HasSubstr("1 here"));
  Scenario another = scenario;
  another.fuel_weight = 1;
  EXPECT_THAT(Ask(QueryFor(another)).message, Not(HasSubstr("other units")));
}

TEST_F(GainUseCasesTest, AStartThatNothingSettlesFromSaysSo) {
  const GainQueryAnswer answer = Ask({.scenario = {.preset_id = "gto-geo-printed"}});
  EXPECT_FALSE(answer.result.settled());
  EXPECT_EQ(answer.result.candidates_settled, 0);
  EXPECT_THAT(answer.message, HasSubstr("None of the 1 candidates settles"));
  EXPECT_THAT(answer.message, HasSubstr("left the domain"));
}

TEST_F(GainUseCasesTest, RefusesAQueryByField) {
  GainQuery query{.scenario = {.preset_id = "leo-rendezvous"}};
  query.initial_condition = KeplerianState{.semi_major_axis_km = 7000, .eccentricity = 1.2};
  ExpectRefused(engine_->gains().Query(query).status(), {"initial_condition.keplerian.eccentricity"});
  // Beyond where the coordinates mean anything.
  query.initial_condition = EquinoctialState{.p_km = 1e12};
  ExpectRefused(engine_->gains().Query(query).status(), {"initial_condition"});
  query.initial_condition = {};
  query.max_candidates = 5000;
  query.max_answers = -1;
  query.refine_budget_ms = 20'000;
  ExpectRefused(engine_->gains().Query(query).status(), {"max_candidates", "max_answers", "refine.budget_ms"});
  ExpectRefused(engine_->gains().Query({.scenario = {.preset_id = "none"}}).status(), {"scenario"});
  ExpectRefused(engine_->gains().Query({}).status(), {"scenario"});
}

TEST_F(GainUseCasesTest, RefinementIsAnsweredOnlyWhereItIsBetter) {
  const Scenario scenario = Rendezvous();
  Tune(scenario);
  GainQuery query = QueryFor(scenario, 0.02);
  const GainQueryAnswer plain = Ask(query);
  query.refine_budget_ms = 3000;  // enough under a sanitizer, too
  const GainQueryAnswer refined = Ask(query);
  ASSERT_TRUE(refined.result.refined);
  EXPECT_GT(refined.result.refined->episodes, 100);
  ASSERT_TRUE(refined.result.refined->improved) << "three iterations of ARS leave nothing to be found?";
  const QueryAnswer& first = refined.result.answers.front();
  EXPECT_EQ(first.candidate.source, Source::kRefined);
  EXPECT_LT(first.flight.cost, plain.result.answers.front().flight.cost);
  EXPECT_TRUE(first.flight.certificate.settled);
  EXPECT_TRUE(first.flight.certificate.lyapunov_decreasing);
  const auto prepared = Prepare(scenario, query.initial_condition);
  EXPECT_EQ(first.flight.cost, SimulateAlone(*prepared, first.candidate.gains).cost);

  const auto cancelled = engine_->gains().Query(query, [] { return true; });
  EXPECT_TRUE(absl::IsCancelled(cancelled.status())) << cancelled.status();
}

TEST_F(GainUseCasesTest, DeletingTheJobKeepsItsGainSetAndDeletingThatRemovesItEverywhere) {
  const Scenario scenario = Rendezvous();
  const std::string id = Tune(scenario);
  ASSERT_TRUE(engine_->use_cases().DeleteJob(id, "").ok());
  EXPECT_TRUE(Has(scenario, id));
  EXPECT_EQ(Get(id).job_id, id);
  ASSERT_TRUE(engine_->gains().Delete(id).ok());
  EXPECT_FALSE(Has(scenario, id));
  EXPECT_TRUE(absl::IsNotFound(engine_->gains().Get(id).status()));
  EXPECT_TRUE(absl::IsNotFound(engine_->gains().Delete(id)));
  Restart();
  EXPECT_FALSE(Has(scenario, id));
}

TEST_F(GainUseCasesTest, AGainSetStartsAnotherJob) {
  const std::string id = Tune(Rendezvous(5));
  NewJob job = JobOf(Rendezvous(1));
  job.warm_start = "gainSets/" + id;
  const auto created = engine_->use_cases().CreateJob(job, "", false);
  ASSERT_TRUE(created.ok()) << created.status();
  EXPECT_EQ(created->spec.scenario.search.initial_gains, Get(id).gains);
}

TEST_F(GainUseCasesTest, ListsByFilterAndPage) {
  const Scenario scenario = Rendezvous(1);
  std::vector<std::string> ids;
  for (int i = 0; i < 5; ++i) ids.insert(ids.begin(), Tune(scenario, 0.01 * i));
  EXPECT_EQ(List(""), ids);
  EXPECT_EQ(List("kind = TUNED AND scenario = small", 2), ids);
  EXPECT_EQ(List("job = jobs/" + ids[2]), std::vector{ids[2]});
  EXPECT_THAT(List("scenario = gto-geo"), IsEmpty());
  EXPECT_THAT(List("kind = MEAN"), IsEmpty());
  EXPECT_THAT(List("campaign = campaigns/none"), IsEmpty());
  for (const char* filter : {"state = RUNNING", "kind = GOOD", "kind != TUNED", "kind = TUNED AND kind = MEAN"}) {
    ExpectRefused(engine_->gains().List(0, "", filter).status(), {"filter"});
  }
  const auto page = engine_->gains().List(2, "", "");
  ASSERT_TRUE(page.ok());
  ExpectRefused(engine_->gains().List(2, page->next_page_token, "kind = TUNED").status(), {"page_token"});
}

TEST_F(GainUseCasesTest, AnImportIsFlownHereBeforeItIsStored) {
  const Scenario scenario = Rendezvous(4);
  const GainSet original = Get(Tune(scenario, 0.03));
  ASSERT_TRUE(engine_->gains().Delete(original.id).ok());
  const auto valid = engine_->gains().Import({Exported(original)}, /*validate_only=*/true);
  ASSERT_TRUE(valid.ok()) << valid.status();
  EXPECT_EQ(valid->imported, 1);
  EXPECT_THAT(List(""), IsEmpty());

  const auto import = engine_->gains().Import({Exported(original)}, false);
  ASSERT_TRUE(import.ok()) << import.status();
  ASSERT_EQ(import->sets.size(), 1u);
  const GainSet set = Get(import->sets[0].id);
  EXPECT_EQ(set.kind, GainSetKind::kImported);
  EXPECT_EQ(set.gains, original.gains);
  EXPECT_NEAR(set.flight.cost, original.flight.cost, 1e-3) << "with the default tolerance";
  EXPECT_EQ(set.scenario_digest, original.scenario_digest);
  EXPECT_EQ(set.origin, "gainSets/" + original.id);
  EXPECT_EQ(set.job_id, "") << "a job of another server";
  EXPECT_TRUE(set.flight.certificate.settled);
  EXPECT_TRUE(Has(scenario, set.id));
}

TEST_F(GainUseCasesTest, ImportingAgainStoresNothingTwice) {
  const GainSet original = Get(Tune(Rendezvous()));
  ImportedGainSet another = Exported(original);
  another.gains[0] *= 1.01;
  const auto first = engine_->gains().Import({Exported(original), another, another}, false);
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_EQ(first->imported, 1);
  EXPECT_EQ(first->sets[0].id, original.id);
  EXPECT_EQ(first->sets[1].id, first->sets[2].id);
  const auto second = engine_->gains().Import({another}, false);
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_EQ(second->imported, 0);
  EXPECT_EQ(second->sets[0].id, first->sets[1].id);
  EXPECT_EQ(List("").size(), 2u);
}

TEST_F(GainUseCasesTest, AnImportIsAllOrNothingAndNamesEveryFault) {
  const GainSet original = Get(Tune(Rendezvous()));
  const ImportedGainSet good = Exported(original);
  ImportedGainSet gains = good;
  gains.gains[1] = -1;
  ImportedGainSet units = good;
  units.acceleration_unit_m_s2 = 1;
  ImportedGainSet start = good;
  start.initial_condition = std::monostate();
  ImportedGainSet digest = good;
  digest.scenario_digest = "0123";
  ImportedGainSet scenario = good;
  scenario.scenario = {.preset_id = "unknown"};
  scenario.scenario_digest = "unknown";
  ImportedGainSet lost = good;
  lost.scenario = {.preset_id = "gto-geo-printed"};
  lost.scenario_digest = "";
  lost.velocity_unit_m_s.reset();
  lost.acceleration_unit_m_s2.reset();
  lost.initial_condition = FindPreset("gto-geo-printed")->chaser;
  lost.gains = {0.1, 1, 1, 1, 10};
  ImportedGainSet unstored = good;
  unstored.gains[0] *= 1.5;
  const auto import = engine_->gains().Import({unstored, gains, units, start, digest, scenario, lost}, false);
  ExpectRefused(import.status(),
                {"gain_sets[1].gains.k2", "gain_sets[2].acceleration_unit_m_s2", "gain_sets[3].initial_condition",
                 "gain_sets[4].scenario_digest", "gain_sets[5].scenario", "gain_sets[6].gains"});
  EXPECT_THAT(std::string(import.status().message()), HasSubstr("left the domain"));
  EXPECT_THAT(List(""), ElementsAre(original.id));
  ExpectRefused(engine_->gains().Import({}, false).status(), {"gain_sets"});
}

// A CSV row has a name and a digest, no definition.
TEST_F(GainUseCasesTest, ImportsByNameAndByAKnownDigest) {
  const GainSet original = Get(Tune(Rendezvous()));
  ImportedGainSet known = Exported(original);
  known.scenario = {.preset_id = "small"};
  known.gains[0] *= 1.01;
  ImportedGainSet preset;
  preset.scenario = {.preset_id = "leo-rendezvous"};
  preset.gains = {0.1, 1, 1, 1, 10};
  preset.initial_condition = FindPreset("leo-rendezvous")->chaser;
  const auto import = engine_->gains().Import({known, preset}, false);
  ASSERT_TRUE(import.ok()) << import.status();
  EXPECT_EQ(import->sets[0].scenario.id, "small");
  EXPECT_EQ(import->sets[0].scenario_digest, original.scenario_digest);
  EXPECT_EQ(import->sets[1].scenario.id, "leo-rendezvous");
  EXPECT_NEAR(import->sets[1].flight.cost, 313.298, 1e-3);
  // A preset exported with its definition is that preset.
  ImportedGainSet again = Exported(import->sets[1]);
  again.gains[0] = 0.2;
  const auto back = engine_->gains().Import({again}, false);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->sets[0].scenario.id, "leo-rendezvous");
}

}  // namespace
}  // namespace orbitune::server_test
