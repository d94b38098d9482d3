// ListJobs and ListUnfinishedJobs against a plain model of them: filter all jobs, sort all, cut the page.
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>

#include "absl/strings/str_cat.h"
#include "tests/storage/job_store_conformance.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

double CostOf(const JobRecord& job) { return job.best ? job.best->cost : kNan; }

bool Contains(const auto& list, const auto& value) { return std::ranges::find(list, value) != list.end(); }

bool Matches(const JobFilter& filter, const JobRecord& job) {
  const std::string& scenario = job.spec.scenario.id;
  if (!filter.states.empty() && !Contains(filter.states, job.state)) return false;
  if (Contains(filter.not_states, job.state)) return false;
  if (!filter.scenario_ids.empty() && !Contains(filter.scenario_ids, scenario)) return false;
  if (Contains(filter.not_scenario_ids, scenario)) return false;
  return std::ranges::all_of(filter.labels, [&job](const JobFilter::Label& label) {
    const auto found = job.spec.labels.find(label.key);
    return (found != job.spec.labels.end() && found->second == label.value) != label.negated;
  });
}

bool Before(const JobQuery& query, const JobRecord& a, const JobRecord& b) {
  if (query.order == JobQuery::Order::kBestCost && std::isnan(CostOf(a)) != std::isnan(CostOf(b))) {
    return std::isnan(CostOf(b));
  }
  const auto key = [&query](const JobRecord& job) {
    const double cost = std::isnan(CostOf(job)) ? 0 : CostOf(job);
    return std::pair(query.order == JobQuery::Order::kCreateTime ? static_cast<double>(job.create_time_us) : cost,
                     job.id);
  };
  return query.descending ? key(b) < key(a) : key(a) < key(b);
}

std::vector<std::string> IdsOf(const std::vector<JobRecord>& jobs) {
  std::vector<std::string> ids;
  for (const JobRecord& job : jobs) ids.push_back(job.id);
  return ids;
}

JobQuery::Cursor Behind(const JobQuery& query, const JobRecord& job) {
  const double key =
      query.order == JobQuery::Order::kCreateTime ? static_cast<double>(job.create_time_us) : CostOf(job);
  return {.key = key, .id = job.id};
}

// All pages, one after another; between_pages() is called before each but the first.
std::vector<JobRecord> Pages(
    JobStore& store, JobQuery query, const std::function<void()>& between_pages = [] {}) {
  std::vector<JobRecord> all;
  for (;;) {
    const auto page = store.ListJobs(query);
    EXPECT_TRUE(page.ok()) << page.status();
    if (!page.ok() || page->empty()) return all;
    EXPECT_LE(page->size(), static_cast<std::size_t>(query.limit));
    all.insert(all.end(), page->begin(), page->end());
    query.after = Behind(query, all.back());
    between_pages();
  }
}

std::vector<std::string> Model(const std::vector<JobRecord>& jobs, const JobQuery& query) {
  std::vector<JobRecord> expected;
  std::ranges::copy_if(jobs, std::back_inserter(expected), [&](const auto& job) { return Matches(query.filter, job); });
  std::ranges::sort(expected, [&](const auto& a, const auto& b) { return Before(query, a, b); });
  return IdsOf(expected);
}

// Jobs of every state, with few different times and costs, so that ties abound.
std::vector<JobRecord> Populate(JobStore& store, int count) {
  std::minstd_rand random(1);
  const auto draw = [&random](unsigned n) { return static_cast<int>(random() % n); };
  std::vector<std::string> ids;
  for (int i = 0; i < count; ++i) {
    JobSpec spec = PlainSpec();
    spec.scenario.id = absl::StrCat("scenario-", draw(3));
    if (draw(2) == 0) spec.labels["team"] = absl::StrCat("team-", draw(3));
    if (draw(2) == 0) spec.labels["it's"] = "100%";
    ids.push_back(absl::StrCat("job-", draw(1000), "-", i));
    EXPECT_TRUE(Create(store, ids.back(), spec, 1'700'000'000'000'000 + draw(6)).ok());
    std::int64_t seq = 1;
    if (draw(3) != 0) {
      const auto outcome = static_cast<Outcome>(draw(3));
      const double cost = HasCost(outcome) ? 100.0 + draw(4) / 4.0 : kNan;
      EXPECT_TRUE(Append(store, ids.back(), ++seq, RecordWith(1, outcome, cost)).ok());
    }
    EXPECT_TRUE(Change(store, ids.back(), ++seq, ChangeTo(static_cast<JobState>(draw(6)), 5)).ok());
  }
  std::vector<JobRecord> jobs;
  for (const std::string& id : ids) jobs.push_back(*store.GetJob(id));
  return jobs;
}

std::vector<JobFilter> SomeFilters() {
  using enum JobState;
  return {{},
          {.states = {kRunning, kQueued}},
          {.states = {kFailed}, .scenario_ids = {"scenario-1"}},
          {.not_states = {kRunning, kCancelled}},
          {.states = {kPaused, kFailed}, .not_states = {kPaused}},
          {.scenario_ids = {"scenario-0", "scenario-2", "no such"}},
          {.not_scenario_ids = {"scenario-0"}},
          {.labels = {{.key = "team", .value = "team-1"}}},
          {.labels = {{.key = "team", .value = "team-1", .negated = true}}},
          {.labels = {{.key = "it's", .value = "100%"}, {.key = "team", .value = "team-2"}}},
          {.labels = {{.key = "it's", .value = "100%", .negated = true}, {.key = "team", .value = "team-0"}}},
          {.scenario_ids = {"' OR 1=1 --"}}};
}

}  // namespace

TEST_P(JobListConformance, FiltersSortsAndPages) {
  const std::vector<JobRecord> jobs = Populate(store(), 60);
  for (const JobFilter& filter : SomeFilters()) {
    for (const auto order : {JobQuery::Order::kCreateTime, JobQuery::Order::kBestCost}) {
      for (const bool descending : {false, true}) {
        for (const int limit : {1, 7, 1000}) {
          const JobQuery query{.filter = filter, .order = order, .descending = descending, .limit = limit, .after = {}};
          ASSERT_EQ(IdsOf(Pages(store(), query)), Model(jobs, query));
        }
      }
    }
  }
}

TEST_P(JobListConformance, ShowsJobsAsGetJobDoesButWithoutReports) {
  JobSpec spec = OddSpec();
  spec.campaign_id.clear();  // those of a campaign are listed by it alone
  ASSERT_TRUE(Create(store(), "a", spec).ok());
  ASSERT_TRUE(Append(store(), "a", 2, RecordOf(1)).ok());
  StateChange succeeded = ChangeTo(JobState::kSucceeded, 5);
  succeeded.report = OddReport();
  ASSERT_TRUE(Change(store(), "a", 3, succeeded).ok());
  JobRecord expected = *store().GetJob("a");
  expected.report.reset();
  const auto jobs = store().ListJobs({});
  ASSERT_TRUE(jobs.ok()) << jobs.status();
  ASSERT_EQ(jobs->size(), 1u);
  EXPECT_EQ(Difference(jobs->front(), expected), "");
}

// Pages neither repeat nor lose a job that was there all the time, while others come and go.
TEST_P(JobListConformance, PagesStayInPlaceWhileJobsComeAndGo) {
  const std::vector<JobRecord> jobs = Populate(store(), 40);
  for (const auto order : {JobQuery::Order::kCreateTime, JobQuery::Order::kBestCost}) {
    for (const bool descending : {false, true}) {
      int added = 0;
      const auto come_and_go = [&] {
        const std::string id = absl::StrCat("job-5-new-", added);
        ASSERT_TRUE(Create(store(), id, PlainSpec(), 1'700'000'000'000'000 + added % 8).ok());
        ASSERT_TRUE(Append(store(), id, 2, RecordWith(1, Outcome::kSettled, 100 + added % 5 / 4.0)).ok());
        if (added % 3 == 2) {
          ASSERT_TRUE(Delete(store(), absl::StrCat("job-5-new-", added - 1)).ok());
        }
        ++added;
      };
      const JobQuery query{.filter = {}, .order = order, .descending = descending, .limit = 5, .after = {}};
      std::vector<std::string> seen = IdsOf(Pages(store(), query, come_and_go));
      std::erase_if(seen, [](const std::string& id) { return id.find("new") != std::string::npos; });
      EXPECT_EQ(seen, Model(jobs, query));
      for (int i = 0; i < added; ++i) (void)Delete(store(), absl::StrCat("job-5-new-", i));
    }
  }
}

TEST_P(JobListConformance, TakesAnyCursor) {
  Populate(store(), 5);
  JobQuery query;
  for (const double key : {kNan, -1e300, 1e300, std::numeric_limits<double>::infinity(), 0.5}) {
    for (const auto order : {JobQuery::Order::kCreateTime, JobQuery::Order::kBestCost}) {
      query.order = order;
      query.after = {.key = key, .id = ""};
      EXPECT_TRUE(store().ListJobs(query).ok());
    }
  }
}

TEST_P(JobListConformance, ListsTheUnfinishedOldestFirst) {
  const std::vector<JobRecord> jobs = Populate(store(), 60);
  const JobQuery query{.filter = {.states = {JobState::kQueued, JobState::kRunning, JobState::kPaused}},
                       .order = JobQuery::Order::kCreateTime,
                       .descending = false,
                       .limit = 1000,
                       .after = {}};
  for (const bool reopen : {false, true}) {
    if (reopen) Reopen();
    const auto unfinished = store().ListUnfinishedJobs();
    ASSERT_TRUE(unfinished.ok()) << unfinished.status();
    EXPECT_EQ(IdsOf(*unfinished), Model(jobs, query));
  }
}

}  // namespace orbitune::storage_test
