#include "server/service/use_cases.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <thread>

#include "server/service/list_filter.h"
#include "server/service/page_token.h"
#include "tests/server/engine_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::UnorderedElementsAre;

// Not pointers to members: a call through one of a list trips UndefinedBehaviorSanitizer (g++ 12).
using Action = absl::StatusOr<JobRecord> (*)(UseCases&, const std::string& id);
constexpr Action kPause = [](UseCases& use_cases, const std::string& id) { return use_cases.PauseJob(id, ""); };
constexpr Action kResume = [](UseCases& use_cases, const std::string& id) { return use_cases.ResumeJob(id, ""); };
constexpr Action kCancel = [](UseCases& use_cases, const std::string& id) { return use_cases.CancelJob(id, ""); };

class UseCasesTest : public ::testing::Test {
 protected:
  // A job that has ended.
  std::string CreateEnded(int iterations = 3) {
    const std::string id = engine_.Create(SmallScenario(iterations));
    EXPECT_EQ(engine_.WaitForEnd(id).state, JobState::kSucceeded);
    return id;
  }

  std::string CreateLabelled(const std::string& key, const std::string& value) {
    NewJob job = JobOf(SmallScenario(1));
    job.labels[key] = value;
    const auto created = use_cases_.CreateJob(job, "", false);
    EXPECT_TRUE(created.ok()) << created.status();
    return created.ok() ? created->id : "";
  }

  struct Listing {
    int page_size = 0;
    std::string filter;
    std::string order_by;
  };
  Page<JobRecord> ListPage(const Listing& listing, const std::string& token) {
    auto page = use_cases_.ListJobs(listing.page_size, token, listing.filter, listing.order_by);
    EXPECT_TRUE(page.ok()) << page.status();
    return page.ok() ? *std::move(page) : Page<JobRecord>{};
  }

  // All pages' ids; `between` runs after each page.
  std::vector<std::string> List(const Listing& listing, const std::function<void()>& between = {}) {
    std::vector<std::string> ids;
    std::string token;
    do {
      const Page<JobRecord> page = ListPage(listing, token);
      for (const JobRecord& job : page.items) ids.push_back(job.id);
      token = page.next_page_token;
      if (between) between();
    } while (!token.empty() && ids.size() < 1000);
    return ids;
  }

  void ExpectRefused(const std::string& id, Action action, const std::string& state) {
    const absl::Status status = action(use_cases_, id).status();
    EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("is " + state));
    EXPECT_EQ(ReasonOf(status), "JOB_STATE");
  }

  TemporaryDirectory directory_;
  Engine engine_{directory_.File("jobs.db")};
  UseCases& use_cases_ = engine_.use_cases();
};

TEST_F(UseCasesTest, ACreatedJobHasEveryDefaultFilledIn) {
  NewJob job;
  job.display_name = "first";
  job.labels["case"] = "1";
  job.scenario.preset_id = "gto-geo";
  job.search.iterations = 7;
  job.search.seed = 99;
  const auto valid = use_cases_.CreateJob(job, "request", true);
  ASSERT_TRUE(valid.ok()) << valid.status();
  EXPECT_EQ(valid->id, "");
  EXPECT_EQ(valid->spec.scenario.search.iterations, 7);
  EXPECT_EQ(valid->spec.scenario.search.directions, 16);
  EXPECT_EQ(valid->spec.scenario.search.seed, 99u);
  EXPECT_TRUE(std::holds_alternative<KeplerianState>(valid->spec.initial_condition));
  EXPECT_THAT(List({}), IsEmpty()) << "validate_only stored a job";
}

TEST_F(UseCasesTest, ADefinitionDoesNotPassForAPreset) {
  Scenario scenario = SmallScenario(1);
  scenario.id = "leo-rendezvous";
  EXPECT_EQ(engine_.Get(engine_.Create(scenario)).spec.scenario.id, "leo-rendezvous-modified");
}

TEST_F(UseCasesTest, TheSameRequestIsTheSameJob) {
  const NewJob job = JobOf(SmallScenario(3));
  const auto first = use_cases_.CreateJob(job, "request", false);
  const auto second = use_cases_.CreateJob(job, "request", false);
  ASSERT_TRUE(first.ok() && second.ok()) << second.status();
  EXPECT_EQ(first->id, second->id);
  EXPECT_EQ(engine_.WaitForEnd(first->id).state, JobState::kSucceeded);
  const auto third = use_cases_.CreateJob(job, "request", false);
  ASSERT_TRUE(third.ok()) << third.status();
  EXPECT_EQ(third->state, JobState::kSucceeded);
  EXPECT_EQ(List({}).size(), 1u);

  NewJob other = job;
  other.search.seed = 2;
  const absl::Status status = use_cases_.CreateJob(other, "request", false).status();
  EXPECT_TRUE(absl::IsAlreadyExists(status)) << status;
  EXPECT_EQ(ReasonOf(status), "REQUEST_ID_REUSED");
  EXPECT_TRUE(use_cases_.CreateJob(other, "another request", false).ok());
}

TEST_F(UseCasesTest, OneRequestFromManyThreadsIsOneJob) {
  const NewJob job = JobOf(SmallScenario(3));
  std::vector<std::string> ids(8);
  std::vector<std::thread> clients;
  for (std::string& id : ids) {
    clients.emplace_back([&] {
      const auto created = use_cases_.CreateJob(job, "request", false);
      ASSERT_TRUE(created.ok()) << created.status();
      id = created->id;
    });
  }
  for (std::thread& client : clients) client.join();
  EXPECT_EQ(std::set<std::string>(ids.begin(), ids.end()).size(), 1u);
  EXPECT_THAT(List({}), ElementsAre(ids[0]));
  EXPECT_EQ(engine_.WaitForEnd(ids[0]).state, JobState::kSucceeded);
  ExpectSameHistory(engine_.History(ids[0]), PlainHistory(SmallScenario(3)));
}

TEST_F(UseCasesTest, ADeletedJobIsGoneAndItsRequestIdFree) {
  const NewJob job = JobOf(SmallScenario(3));
  const std::string id = use_cases_.CreateJob(job, "request", false)->id;
  engine_.WaitForEnd(id);
  EXPECT_TRUE(use_cases_.DeleteJob(id, "").ok());
  EXPECT_TRUE(absl::IsNotFound(use_cases_.GetJob(id).status()));
  EXPECT_TRUE(absl::IsNotFound(use_cases_.ListIterations(id, 0, "").status()));
  EXPECT_TRUE(absl::IsNotFound(use_cases_.DeleteJob(id, "")));
  const auto again = use_cases_.CreateJob(job, "request", false);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_NE(again->id, id);
}

TEST_F(UseCasesTest, AnOldEtagIsAborted) {
  const std::string id = engine_.Create(EndlessScenario());
  engine_.WaitForIterations(id, 1);
  const std::string running = EtagOf(engine_.Get(id));
  const auto paused = use_cases_.PauseJob(id, running);
  ASSERT_TRUE(paused.ok()) << paused.status();
  EXPECT_NE(EtagOf(*paused), running);
  for (const std::string& etag : {running, std::string("x")}) {
    for (const absl::Status& status :
         {use_cases_.ResumeJob(id, etag).status(), use_cases_.CancelJob(id, etag).status()}) {
      EXPECT_TRUE(absl::IsAborted(status)) << status;
      EXPECT_EQ(ReasonOf(status), "ETAG_MISMATCH");
      EXPECT_THAT(std::string(status.message()), HasSubstr(EtagOf(*paused)));
    }
  }
  EXPECT_EQ(engine_.Get(id).state, JobState::kPaused);
  const auto cancelled = use_cases_.CancelJob(id, EtagOf(*paused));
  ASSERT_TRUE(cancelled.ok()) << cancelled.status();
  EXPECT_TRUE(absl::IsAborted(use_cases_.DeleteJob(id, running)));
  EXPECT_TRUE(use_cases_.DeleteJob(id, EtagOf(*cancelled)).ok());
}

TEST_F(UseCasesTest, WhatTheStateForbidsIsRefusedNamingIt) {
  const std::string ended = CreateEnded();
  for (const auto action : {kPause, kResume, kCancel}) {
    ExpectRefused(ended, action, "SUCCEEDED");
  }
  const std::string id = engine_.Create(EndlessScenario());
  engine_.WaitForIterations(id, 1);
  ExpectRefused(id, kResume, "RUNNING");
  absl::Status status = use_cases_.DeleteJob(id, "");
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("is RUNNING"));
  ASSERT_TRUE(use_cases_.PauseJob(id, "").ok());
  ExpectRefused(id, kPause, "PAUSED");
  status = use_cases_.DeleteJob(id, "");
  EXPECT_THAT(std::string(status.message()), HasSubstr("is PAUSED"));
  ASSERT_TRUE(use_cases_.CancelJob(id, "").ok());
  for (const auto action : {kPause, kResume, kCancel}) {
    ExpectRefused(id, action, "CANCELLED");
    EXPECT_TRUE(absl::IsNotFound(action(use_cases_, "none").status()));
  }
}

TEST_F(UseCasesTest, IterationsComeInPages) {
  const std::string id = CreateEnded(25);
  std::vector<IterationRecord> all;
  std::string token;
  int pages = 0;
  do {
    const auto page = use_cases_.ListIterations(id, 10, token);
    ASSERT_TRUE(page.ok()) << page.status();
    all.insert(all.end(), page->items.begin(), page->items.end());
    token = page->next_page_token;
    ++pages;
  } while (!token.empty());
  EXPECT_EQ(pages, 3);
  ExpectSameHistory(all, PlainHistory(SmallScenario(25)));
  EXPECT_EQ(use_cases_.ListIterations(id, 25, "")->next_page_token, "");
}

TEST_F(UseCasesTest, IterationsComeAsASample) {
  const std::string id = CreateEnded(25);
  EXPECT_EQ(use_cases_.SampleIterations(id, 25)->items.size(), 25u);
  const auto sample = use_cases_.SampleIterations(id, 16);
  ASSERT_TRUE(sample.ok()) << sample.status();
  EXPECT_LE(sample->items.size(), 16u);
  EXPECT_EQ(sample->items.back().iteration, 25);
  EXPECT_EQ(sample->next_page_token, "");
  for (const int wrong : {-1, 15, 10'001}) {
    EXPECT_THAT(ViolatedFields(use_cases_.SampleIterations(id, wrong).status()), ElementsAre("max_points")) << wrong;
  }
  EXPECT_EQ(use_cases_.SampleIterations(id, 16, 20)->items.size(), 6u);
  EXPECT_EQ(use_cases_.SampleIterations(id, 16, 0, 3)->items.size(), 3u);
  const auto violated = [&](int first, int last) {
    return ViolatedFields(use_cases_.SampleIterations(id, 16, first, last).status());
  };
  EXPECT_THAT(violated(-1, 0), ElementsAre("first_iteration"));
  EXPECT_THAT(violated(5, 4), ElementsAre("last_iteration"));
}

TEST_F(UseCasesTest, ScenariosComeInPages) {
  std::vector<std::string> ids;
  std::string token;
  do {
    const auto page = use_cases_.ListScenarios(2, token);
    ASSERT_TRUE(page.ok()) << page.status();
    for (const Scenario& scenario : page->items) ids.push_back(scenario.id);
    token = page->next_page_token;
  } while (!token.empty());
  EXPECT_THAT(ids, ElementsAre("gto-geo", "gto-geo-printed", "leo-rendezvous"));
}

TEST_F(UseCasesTest, JobsComeInPagesWhileOthersAreAdded) {
  std::vector<std::string> old;
  for (int i = 0; i < 5; ++i) old.push_back(CreateEnded(1));
  int added = 0;
  const auto add = [&] {
    if (++added < 20) engine_.Create(SmallScenario(1));
  };
  // Newest first: what is added comes before the first page.
  EXPECT_EQ(List({.page_size = 2}, add), std::vector<std::string>(old.rbegin(), old.rend()));
  // Oldest first: what is added comes at the end, once each.
  const std::vector<std::string> all = List({.page_size = 2, .order_by = "create_time"}, add);
  EXPECT_EQ(std::vector<std::string>(all.begin(), all.begin() + 5), old);
  EXPECT_EQ(std::set<std::string>(all.begin(), all.end()).size(), all.size());
  EXPECT_GT(all.size(), 8u);
}

TEST_F(UseCasesTest, ThePageAfterADeletedJobIsThereAllTheSame) {
  std::vector<std::string> ids;
  for (int i = 0; i < 5; ++i) ids.push_back(CreateEnded(1));
  const Page<JobRecord> first = ListPage({.page_size = 2, .order_by = "create_time"}, "");
  ASSERT_TRUE(use_cases_.DeleteJob(ids[1], "").ok());
  const Page<JobRecord> second = ListPage({.page_size = 5, .order_by = "create_time"}, first.next_page_token);
  ASSERT_EQ(second.items.size(), 3u);
  EXPECT_EQ(second.items[0].id, ids[2]);
}

TEST_F(UseCasesTest, JobsByBestCostWithThoseThatHaveNoneLast) {
  std::vector<std::string> ended;
  for (const double weight : {3.0, 1.0, 2.0}) {
    Scenario scenario = SmallScenario(1);
    scenario.fuel_weight = weight;
    ended.push_back(engine_.Create(scenario));
    engine_.WaitForEnd(ended.back());
  }
  std::vector<std::string> without;
  for (int i = 0; i < 2; ++i) {
    NewJob job;
    job.scenario.preset_id = "gto-geo-printed";
    without.push_back(use_cases_.CreateJob(job, "", false)->id);
    engine_.WaitForEnd(without.back());
  }
  std::ranges::sort(without);
  EXPECT_THAT(List({.page_size = 1, .order_by = "best_cost"}),
              ElementsAre(ended[1], ended[2], ended[0], without[0], without[1]));
  EXPECT_THAT(List({.page_size = 2, .order_by = "best_cost desc"}),
              ElementsAre(ended[0], ended[2], ended[1], without[1], without[0]));
}

TEST_F(UseCasesTest, FilteredJobs) {
  const std::string a = CreateLabelled("case", "a \"b\"");
  const std::string b = CreateLabelled("case", "plain");
  for (const std::string& id : {a, b}) engine_.WaitForEnd(id);
  const std::string running = engine_.Create(EndlessScenario());
  engine_.WaitForIterations(running, 1);
  EXPECT_THAT(List({.filter = "labels.case = \"a \\\"b\\\"\""}), ElementsAre(a));
  EXPECT_THAT(List({.filter = "labels.case=plain AND state = SUCCEEDED"}), ElementsAre(b));
  EXPECT_THAT(List({.filter = "labels.case != plain"}), UnorderedElementsAre(a, running));
  EXPECT_THAT(List({.filter = "text = \"CASE=plai\""}), ElementsAre(b));
  EXPECT_THAT(List({.filter = "text = \"" + a.substr(2) + "\" AND text = case"}), ElementsAre(a));
  EXPECT_THAT(List({.filter = "text = \"%\""}), ElementsAre());
  EXPECT_THAT(List({.filter = "state = RUNNING"}), ElementsAre(running));
  EXPECT_THAT(List({.filter = "state != RUNNING AND state != FAILED"}), UnorderedElementsAre(a, b));
  EXPECT_EQ(List({.filter = "scenario = small"}).size(), 3u);
  EXPECT_EQ(List({.filter = "scenario = \"scenarios/small\""}).size(), 3u);
  EXPECT_THAT(List({.filter = "scenario != small"}), IsEmpty());
  EXPECT_EQ(List({.filter = "  "}).size(), 3u);
}

TEST_F(UseCasesTest, AFilterThatIsNoneSaysWhatWasExpectedWhere) {
  const std::pair<std::string, std::string> cases[] = {
      {"colour = red", "at character 1: state, scenario, campaign, text or labels.KEY"},
      {"labels. = x", "at character 1"},
      {"state", "at character 6: = or !="},
      {"state > RUNNING", "at character 7"},
      {"state = ", "at character 9: a value"},
      {"state = DANCING", "at character 9: a state: QUEUED, RUNNING"},
      {"state = RUNNING OR state = QUEUED", "at character 17: AND"},
      {"state = RUNNING AND", "at character 20: state, scenario"},
      {"labels.a = \"open", "a closing quote"},
      {"= x", "at character 1"},
      {"state = QUEUED AND state = RUNNING", "one = comparison at most"},
      {"state = \x01", "at character 9"}};
  for (const auto& [filter, expected] : cases) {
    SCOPED_TRACE(filter);
    const absl::Status status = use_cases_.ListJobs(0, "", filter, "").status();
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
    EXPECT_THAT(ViolatedFields(status), ElementsAre("filter"));
    EXPECT_THAT(std::string(status.message()), HasSubstr(expected));
  }
}

TEST_F(UseCasesTest, AnOrderThatIsNoneIsRefused) {
  for (const std::string order : {"name", "create_time asc", "best_cost  desc", "DESC", "create_time, best_cost"}) {
    const absl::Status status = use_cases_.ListJobs(0, "", "", order).status();
    EXPECT_THAT(ViolatedFields(status), ElementsAre("order_by")) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(order));
  }
}

TEST_F(UseCasesTest, AForeignOrDamagedPageTokenIsRefused) {
  for (int i = 0; i < 3; ++i) CreateEnded(3);
  const std::string id = CreateEnded(3);
  const std::string jobs = ListPage({.page_size = 1}, "").next_page_token;
  const std::string iterations = use_cases_.ListIterations(id, 1, "")->next_page_token;
  const std::string scenarios = use_cases_.ListScenarios(1, "")->next_page_token;
  ASSERT_FALSE(jobs.empty() || iterations.empty() || scenarios.empty());

  const auto expect_refused = [](const absl::Status& status) {
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
    EXPECT_THAT(ViolatedFields(status), ElementsAre("page_token"));
  };
  std::vector<std::string> damaged = {"x",
                                      "garbage",
                                      "====",
                                      jobs + "A",
                                      std::string(100, '\n'),
                                      MakePageToken("jobs", {}),
                                      MakePageToken("", {"1", id})};
  for (std::size_t i = 0; i < jobs.size(); i += 3) {
    damaged.push_back(jobs);
    damaged.back()[i] = damaged.back()[i] == 'A' ? 'B' : 'A';
    damaged.push_back(jobs.substr(0, i));
    if (damaged.back().empty()) damaged.pop_back();
  }
  for (const std::string& token : damaged) {
    SCOPED_TRACE(token);
    expect_refused(use_cases_.ListJobs(1, token, "", "").status());
    expect_refused(use_cases_.ListIterations(id, 1, token).status());
    expect_refused(use_cases_.ListScenarios(1, token).status());
  }
  expect_refused(use_cases_.ListJobs(1, jobs, "state = SUCCEEDED", "").status());
  expect_refused(use_cases_.ListJobs(1, jobs, "", "create_time").status());
  expect_refused(use_cases_.ListJobs(1, iterations, "", "").status());
  expect_refused(use_cases_.ListScenarios(1, jobs).status());
  expect_refused(use_cases_.ListIterations(id, 1, scenarios).status());
  expect_refused(use_cases_.ListIterations("none", 1, iterations).status());
  EXPECT_TRUE(use_cases_.ListJobs(2, jobs, "", "").ok()) << "another page size is the same list";
}

TEST_F(UseCasesTest, PageSizes) {
  for (int i = 0; i < 3; ++i) CreateEnded(1);
  for (const absl::Status& status :
       {use_cases_.ListJobs(-1, "", "", "").status(), use_cases_.ListScenarios(-7, "").status(),
        use_cases_.ListIterations("x", -1, "").status()}) {
    EXPECT_THAT(ViolatedFields(status), ElementsAre("page_size")) << status;
  }
  EXPECT_EQ(ListPage({.page_size = 1'000'000'000}, "").items.size(), 3u);
  EXPECT_EQ(ListPage({.page_size = 3}, "").next_page_token, "");
}

TEST_F(UseCasesTest, EveryFaultOfAJobIsToldAtOnce) {
  NewJob job = JobOf(SmallScenario());
  job.display_name = std::string(300, 'x');
  job.labels["Upper Case"] = "x";
  job.scenario.definition->horizon_samples = 0;
  job.scenario.definition->fuel_weight = -1;
  EXPECT_THAT(ViolatedFields(use_cases_.CreateJob(job, "", false).status()),
              UnorderedElementsAre("job.display_name", "job.labels key", "job.scenario_definition.horizon_samples",
                                   "job.scenario_definition.fuel_weight"));
}

TEST_F(UseCasesTest, AHyperparameterIsNamedWhereItWasGiven) {
  NewJob job = JobOf(SmallScenario());
  job.scenario.definition->search.step_size = -1;
  job.scenario.definition->search.initial_gains[2] = 0;
  job.search.directions = 0;
  EXPECT_THAT(ViolatedFields(use_cases_.CreateJob(job, "", false).status()),
              UnorderedElementsAre("job.scenario_definition.hyperparameters.step_size",
                                   "job.scenario_definition.hyperparameters.initial_gains.k3",
                                   "job.hyperparameters.directions"));
  // What the job sets, the definition need not have right.
  job.search = {.step_size = 0.1, .initial_gains = Gains{1, 1, 1, 1, 1}};
  EXPECT_TRUE(use_cases_.CreateJob(job, "", true).ok());
}

TEST_F(UseCasesTest, AnEpisodeIsTheSimulatorsOwn) {
  EpisodeRequest request;
  request.scenario.definition = SmallScenario();
  request.scenario.definition->horizon_samples = 1280;
  request.include_trajectory = true;
  request.sample_stride = 3;
  const auto whole = use_cases_.SimulateEpisode(request);
  ASSERT_TRUE(whole.ok()) << whole.status();
  EXPECT_EQ(whole->trajectory.size(), 427u);  // samples 0, 3, ..., 1278
  EXPECT_EQ(whole->trajectory.back().sample, 1278);
  request.early_exit = true;
  const auto early = use_cases_.SimulateEpisode(request);
  ASSERT_TRUE(early.ok()) << early.status();
  EXPECT_EQ(early->report.cost, whole->report.cost);
  EXPECT_EQ(early->report.fuel_sum, whole->report.fuel_sum);
  EXPECT_LT(early->report.end_time_s, whole->report.end_time_s);

  request.gains = Gains{1, 1, 0, 1, -1};
  request.sample_stride = -1;
  EXPECT_THAT(ViolatedFields(use_cases_.SimulateEpisode(request).status()),
              ElementsAre("gains.k3", "gains.k5", "sample_stride"));
}

}  // namespace
}  // namespace orbitune::server_test
