#include "tests/storage/job_store_conformance.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <limits>
#include <set>
#include <thread>

#include "absl/strings/str_cat.h"
#include "core/library/scenario_digest.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {

void JobStoreConformance::SetUp() {
  backend_ = GetParam()();
  Reopen();
}

void JobStoreConformance::Reopen() {
  store_.reset();
  auto store = backend_->Open();
  ASSERT_TRUE(store.ok()) << store.status();
  store_ = *std::move(store);
}

TEST_P(JobStoreConformance, KeepsAJobWithAllItsFields) {
  const auto created = Create(store(), "odd", OddSpec(), 1'700'000'000'000'001);
  ASSERT_TRUE(created.ok()) << created.status();
  JobRecord expected;
  expected.id = "odd";
  expected.spec = OddSpec();
  expected.create_time_us = expected.update_time_us = 1'700'000'000'000'001;
  expected.last_seq = expected.state_changes = 1;
  expected.provenance = created->provenance;
  EXPECT_EQ(Difference(*created, expected), "");

  StateChange succeeded = ChangeTo(JobState::kSucceeded, 30, "");
  succeeded.report = OddReport();
  ASSERT_TRUE(Change(store(), "odd", 2, ChangeTo(JobState::kRunning, 20)).ok());
  ASSERT_TRUE(Append(store(), "odd", 3, RecordOf(1)).ok());
  ASSERT_TRUE(Append(store(), "odd", 4, RecordOf(2)).ok());
  ASSERT_TRUE(Change(store(), "odd", 5, succeeded).ok());
  expected.state = JobState::kSucceeded;
  expected.start_time_us = 20;
  expected.end_time_us = expected.update_time_us = 30;
  expected.last_seq = 5;
  expected.state_changes = 3;
  expected.first = RecordOf(1);
  expected.latest = expected.best = RecordOf(2);
  expected.report = OddReport();
  expected.provenance->digest = {};
  for (const bool reopen : {false, true}) {
    if (reopen) Reopen();
    const auto job = store().GetJob("odd");
    ASSERT_TRUE(job.ok()) << job.status();
    EXPECT_EQ(Difference(*job, expected), "");
    EXPECT_EQ(job->completed_iterations(), 2);
  }
}

TEST_P(JobStoreConformance, KeepsEveryBitOfAnIteration) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  ASSERT_TRUE(Create(store(), "a").ok());
  IterationRecord record = RecordOf(1);
  record.gains = {-0.0, 5e-324, std::numeric_limits<double>::infinity(), 1.7976931348623157e308, 4503599627370497.5};
  record.cost = -0.0;
  record.fuel_sum = kNan;
  record.cost_std = 1e15;
  record.settling_samples = record.pairs_left_out = std::numeric_limits<int>::max();
  record.pairs_not_settled = std::numeric_limits<int>::min();
  ASSERT_TRUE(Append(store(), "a", 2, record).ok());
  IterationRecord none = RecordWith(2, Outcome::kNumericalFailure, kNan);
  none.gains.fill(kNan);
  ASSERT_TRUE(Append(store(), "a", 3, none).ok());
  const auto records = store().ListIterations("a", 0, 10);
  ASSERT_TRUE(records.ok()) << records.status();
  ASSERT_EQ(records->size(), 2);
  EXPECT_TRUE(Identical((*records)[0], record));
  EXPECT_TRUE(Identical((*records)[1], none));
}

TEST_P(JobStoreConformance, SetsTimesAndMessagesByTheirStates) {
  ASSERT_TRUE(Create(store(), "a", PlainSpec(), 10).ok());
  ASSERT_TRUE(Change(store(), "a", 2, ChangeTo(JobState::kRunning, 20)).ok());
  ASSERT_TRUE(Change(store(), "a", 3, ChangeTo(JobState::kPaused, 30, "not an error")).ok());
  ASSERT_TRUE(Change(store(), "a", 4, ChangeTo(JobState::kRunning, 40)).ok());
  auto job = store().GetJob("a");
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->start_time_us, 20);
  EXPECT_EQ(job->end_time_us, 0);
  EXPECT_EQ(job->update_time_us, 40);
  EXPECT_EQ(job->state_changes, 4);
  EXPECT_EQ(job->error_message, "");
  ASSERT_TRUE(Change(store(), "a", 5, ChangeTo(JobState::kFailed, 50, "all pairs left")).ok());
  job = store().GetJob("a");
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->state, JobState::kFailed);
  EXPECT_EQ(job->end_time_us, 50);
  EXPECT_EQ(job->error_message, "all pairs left");
}

// Every window of a history with pauses between its iterations.
TEST_P(JobStoreConformance, ListsEventsDenseAndInOrder) {
  std::vector<JobEvent> expected{{.seq = 1, .what = ChangeTo(JobState::kQueued, 1)}};
  ASSERT_TRUE(Create(store(), "a").ok());
  const auto change = [&](StateChange what) {
    expected.push_back({.seq = static_cast<std::int64_t>(expected.size()) + 1, .what = what});
    ASSERT_TRUE(Change(store(), "a", expected.back().seq, what).ok());
  };
  int iteration = 0;
  const auto iterate = [&](int count) {
    for (int i = 0; i < count; ++i) {
      expected.push_back({.seq = static_cast<std::int64_t>(expected.size()) + 1, .what = RecordOf(++iteration)});
      ASSERT_TRUE(Append(store(), "a", expected.back().seq, RecordOf(iteration)).ok());
    }
  };
  change(ChangeTo(JobState::kRunning, 2));
  iterate(3);
  change(ChangeTo(JobState::kPaused, 3, "by its owner"));
  change(ChangeTo(JobState::kRunning, 4));
  iterate(1);
  change(ChangeTo(JobState::kPaused, 5));
  change(ChangeTo(JobState::kQueued, 6));
  change(ChangeTo(JobState::kRunning, 7));
  iterate(4);
  StateChange succeeded = ChangeTo(JobState::kSucceeded, 8);
  succeeded.report = OddReport();
  change(succeeded);

  const auto total = static_cast<int>(expected.size());
  for (int after = -1; after <= total + 1; ++after) {
    for (int limit = 0; limit <= total + 1; ++limit) {
      const auto events = store().ListEvents("a", after, limit);
      ASSERT_TRUE(events.ok()) << events.status();
      const int begin = std::clamp(after, 0, total);
      ASSERT_EQ(events->size(), static_cast<std::size_t>(std::min(limit, total - begin)));
      for (std::size_t i = 0; i < events->size(); ++i) {
        ASSERT_EQ(Difference((*events)[i], expected[static_cast<std::size_t>(begin) + i]), "");
      }
    }
  }
}

TEST_P(JobStoreConformance, ListsIterationsFromAny) {
  CreateWithIterations(store(), "a", 20);
  CreateWithIterations(store(), "b", 3);
  for (const int after : {-3, 0, 1, 19, 20, 21}) {
    const auto records = store().ListIterations("a", after, 5);
    ASSERT_TRUE(records.ok()) << records.status();
    const int begin = std::clamp(after, 0, 20);
    ASSERT_EQ(records->size(), static_cast<std::size_t>(std::min(5, 20 - begin)));
    for (std::size_t i = 0; i < records->size(); ++i) {
      EXPECT_TRUE(Identical((*records)[i], RecordOf(begin + 1 + static_cast<int>(i))));
    }
  }
}

TEST_P(JobStoreConformance, SamplesAllOfAShortHistory) {
  CreateWithIterations(store(), "a", 16);
  const auto records = store().SampleIterations("a", {}, 16);
  ASSERT_TRUE(records.ok()) << records.status();
  ASSERT_EQ(records->size(), 16u);
  for (int i = 0; i < 16; ++i) EXPECT_TRUE(Identical((*records)[static_cast<std::size_t>(i)], RecordOf(i + 1)));
  EXPECT_TRUE(absl::IsNotFound(store().SampleIterations("none", {}, 16).status()));
}

// Peaks, dips and an iteration without a cost, each a single one among 2000, are in any sample.
TEST_P(JobStoreConformance, SamplesKeepTheExtremesOfALongHistory) {
  constexpr int kCount = 2000;
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  ASSERT_TRUE(Create(store(), "a").ok());
  for (int i = 1; i <= kCount; ++i) {
    double cost = 1000 - 0.1 * i;
    if (i == 777) cost = 5000;
    if (i == 1301) cost = 2;
    if (i == 1500) cost = kNan;
    const Outcome outcome = i == 1500 ? Outcome::kLeftDomain : i == 1301 ? Outcome::kNotSettled : Outcome::kSettled;
    store().AppendIteration("a", i + 1, RecordWith(i, outcome, cost), {}, [](absl::Status) {});
  }
  store().Flush();
  for (const int max_points : {16, 17, 100, 1999}) {
    SCOPED_TRACE(max_points);
    const auto records = store().SampleIterations("a", {}, max_points);
    ASSERT_TRUE(records.ok()) << records.status();
    EXPECT_LE(records->size(), static_cast<std::size_t>(max_points));
    EXPECT_GE(records->size(), static_cast<std::size_t>(max_points / 2));
    std::set<int> seen;
    for (const IterationRecord& record : *records) {
      EXPECT_TRUE(seen.empty() || record.iteration > *seen.rbegin());
      seen.insert(record.iteration);
    }
    for (const int kept : {1, 777, 1301, 1500, kCount}) EXPECT_TRUE(seen.contains(kept)) << kept;
    EXPECT_TRUE(seen.contains(store().GetJob("a")->best->iteration));
  }
}

TEST_P(JobStoreConformance, SamplesAStretchOfAHistory) {
  CreateWithIterations(store(), "a", 200);
  const auto iterations = [&](IterationRange range) {
    std::vector<int> found;
    const auto records = store().SampleIterations("a", range, 16);
    if (!records.ok()) ADD_FAILURE() << records.status();
    for (const IterationRecord& record : *records) found.push_back(record.iteration);
    return found;
  };
  const auto long_stretch = iterations({.first = 50, .last = 149});
  EXPECT_EQ(long_stretch.front(), 50);
  EXPECT_EQ(long_stretch.back(), 149);
  EXPECT_LE(long_stretch.size(), 16u);
  EXPECT_GE(long_stretch.size(), 8u);
  EXPECT_EQ(iterations({.first = 100, .last = 103}), (std::vector{100, 101, 102, 103}));
  EXPECT_EQ(iterations({.first = 199, .last = 5000}), (std::vector{199, 200}));
  EXPECT_EQ(iterations({.first = 201}), std::vector<int>());
  EXPECT_EQ(iterations({.first = 7, .last = 6}), std::vector<int>());
}

TEST_P(JobStoreConformance, KeepsTheBestByBetterAndTheEarliestOfEquals) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<IterationRecord> records{
      RecordWith(1, Outcome::kLeftDomain, kNan),    RecordWith(2, Outcome::kNumericalFailure, kNan),
      RecordWith(3, Outcome::kNotSettled, 5),       RecordWith(4, Outcome::kNotSettled, 5),
      RecordWith(5, Outcome::kSettled, 900),        RecordWith(6, Outcome::kNotSettled, 1),
      RecordWith(7, Outcome::kSettled, 800),        RecordWith(8, Outcome::kSettled, 800),
      RecordWith(9, Outcome::kSettled, 799.999999), RecordWith(10, Outcome::kLeftDomain, kNan)};
  ASSERT_TRUE(Create(store(), "a").ok());
  IterationRecord best = records.front();
  for (const IterationRecord& record : records) {
    if (Better(record, best)) best = record;
    ASSERT_TRUE(Append(store(), "a", record.iteration + 1, record).ok());
    if (record.iteration % 3 == 0) Reopen();
    const auto job = store().GetJob("a");
    ASSERT_TRUE(job.ok()) << job.status();
    ASSERT_TRUE(job->best.has_value());
    EXPECT_TRUE(Identical(*job->best, best)) << job->best->iteration << " for " << best.iteration;
    EXPECT_TRUE(Identical(*job->latest, record));
    EXPECT_TRUE(Identical(*job->first, records.front()));
  }
}

TEST_P(JobStoreConformance, KeepsTheProvenanceOfAJobForGood) {
  const Engine here{.version = "1", .simd_target = "avx2", .fused_multiply_add = true, .libraries = "\"glibc\" 2"};
  const Engine there{.version = "2", .simd_target = "baseline", .libraries = ""};
  const auto created = Create(store(), "a");
  ASSERT_TRUE(created.ok()) << created.status();
  ASSERT_TRUE(created->provenance);
  EXPECT_EQ(created->provenance->inputs_digest, ToHex(created->provenance->digest));
  EXPECT_EQ(created->provenance->scenario_digest, ScenarioDigest(created->spec.scenario));
  EXPECT_EQ(Difference(*store().GetJob("a"), *created), "");
  const auto ok = [](const absl::Status& status) { EXPECT_TRUE(status.ok()) << status; };
  store().AppendIteration("a", 2, RecordOf(1), {.digest = Sha256("1"), .engine = here}, ok);
  store().AppendIteration("a", 3, RecordOf(2), {.digest = Sha256("2")}, ok);
  store().Flush();
  Reopen();
  store().AppendIteration("a", 4, RecordOf(3), {.digest = Sha256("3"), .engine = there}, ok);
  ASSERT_TRUE(Change(store(), "a", 5, ChangeTo(JobState::kCancelled)).ok());
  Reopen();
  const auto kept = store().GetJob("a")->provenance;
  ASSERT_TRUE(kept);
  EXPECT_EQ(kept->digest, Sha256("3"));
  EXPECT_EQ(kept->inputs_digest, created->provenance->inputs_digest);
  EXPECT_EQ(kept->backfilled, 0);
  ASSERT_EQ(kept->engines.size(), 2u);
  EXPECT_EQ(kept->engines[0].first_iteration, 1);
  EXPECT_EQ(kept->engines[0].engine, here);
  EXPECT_EQ(kept->engines[1].first_iteration, 3);
  EXPECT_EQ(kept->engines[1].engine, there);
  EXPECT_EQ(store().ListJobs({})->at(0).provenance->digest, Sha256("3"));
}

// With the newest iteration, until the job ends.
TEST_P(JobStoreConformance, KeepsTheCheckpointOfTheNewestIteration) {
  ASSERT_TRUE(Create(store(), "a").ok());
  ASSERT_TRUE(Create(store(), "b").ok());
  EXPECT_TRUE(store().GetJob("a")->checkpoint.empty());
  const std::vector<double> last{-0.0, std::numeric_limits<double>::denorm_min(), 0.1, 4, 5, 6};
  const auto ok = [](const absl::Status& status) { EXPECT_TRUE(status.ok()) << status; };
  store().AppendIteration("a", 2, RecordOf(1), {.checkpoint = {1, 2, 3}}, ok);
  store().AppendIteration("b", 2, RecordOf(1), {.checkpoint = {7}}, ok);
  store().AppendIteration("a", 3, RecordOf(2), {.checkpoint = last}, ok);
  store().Flush();
  Reopen();
  const auto kept = store().GetJob("a")->checkpoint;
  ASSERT_EQ(kept, last);
  EXPECT_TRUE(std::signbit(kept[0]));
  EXPECT_EQ(store().ListUnfinishedJobs()->at(0).checkpoint, last);
  EXPECT_EQ(store().GetJob("b")->checkpoint, std::vector<double>{7});
  ASSERT_TRUE(Change(store(), "a", 4, ChangeTo(JobState::kRunning)).ok());
  EXPECT_EQ(store().GetJob("a")->checkpoint, last);
  store().AppendIteration("a", 5, RecordOf(3), {.checkpoint = {8}}, ok);
  ASSERT_TRUE(Change(store(), "a", 6, ChangeTo(JobState::kCancelled)).ok());
  EXPECT_TRUE(store().GetJob("a")->checkpoint.empty());
}

TEST_P(JobStoreConformance, AnswersInOrderAndAfterTheCommit) {
  constexpr int kCount = 3000;
  ASSERT_TRUE(Create(store(), "a").ok());
  std::vector<int> answered;  // on the writer's thread only, until Flush
  for (int i = 1; i <= kCount; ++i) {
    store().AppendIteration("a", i + 1, RecordOf(i), {}, [&, i](const absl::Status& status) {
      EXPECT_TRUE(status.ok()) << status;
      answered.push_back(i);
      if (i % 500 != 0) return;
      const auto job = store().GetJob("a");
      ASSERT_TRUE(job.ok()) << job.status();
      EXPECT_GE(job->last_seq, i + 1);
    });
  }
  store().Flush();
  ASSERT_EQ(answered.size(), kCount);
  for (int i = 1; i <= kCount; ++i) ASSERT_EQ(answered[static_cast<std::size_t>(i - 1)], i);
  EXPECT_TRUE(store().ok_for_now().ok());
}

// Refused operations between good ones, all queued at once.
TEST_P(JobStoreConformance, RefusesWhatDoesNotFollowAndNothingElse) {
  ASSERT_TRUE(Create(store(), "a").ok());
  std::vector<absl::StatusCode> codes;
  const auto done = [&codes](const absl::Status& status) { codes.push_back(status.code()); };
  store().AppendIteration("a", 2, RecordOf(1), {}, done);
  store().AppendIteration("a", 2, RecordOf(2), {}, done);  // seq taken
  store().AppendIteration("a", 4, RecordOf(2), {}, done);  // seq skipped
  store().AppendIteration("a", 3, RecordOf(3), {}, done);  // iteration skipped
  store().AppendIteration("a", 3, RecordOf(1), {}, done);  // iteration taken
  store().AppendIteration("nobody", 2, RecordOf(1), {}, done);
  store().ChangeState("a", 2, ChangeTo(JobState::kRunning), done);
  store().ChangeState("nobody", 2, ChangeTo(JobState::kRunning), done);
  store().DeleteJob("nobody", done);
  store().CreateJob("a", PlainSpec(), 1, "", "", [&](const auto& job) { codes.push_back(job.status().code()); });
  store().AppendIteration("a", 3, RecordOf(2), {}, done);
  store().ChangeState("a", 4, ChangeTo(JobState::kRunning, 7), done);
  store().Flush();
  using enum absl::StatusCode;
  EXPECT_EQ(codes, (std::vector{kOk, kInternal, kInternal, kInternal, kInternal, kNotFound, kInternal, kNotFound,
                                kNotFound, kInternal, kOk, kOk}));
  const auto job = store().GetJob("a");
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->last_seq, 4);
  EXPECT_EQ(job->state_changes, 2);
  EXPECT_EQ(job->completed_iterations(), 2);
  EXPECT_EQ(store().ListEvents("a", 0, 100)->size(), 4);
}

TEST_P(JobStoreConformance, RefusesATextThatIsNotUtf8) {
  JobSpec spec = PlainSpec("\xff\xfe");
  EXPECT_TRUE(absl::IsInvalidArgument(Create(store(), "a", spec).status()));
  EXPECT_TRUE(absl::IsNotFound(store().GetJob("a").status()));
  EXPECT_TRUE(Create(store(), "a").ok());
  // A report's texts are made fit instead.
  StateChange change = ChangeTo(JobState::kSucceeded);
  change.report = OddReport();
  change.report->warnings[0].message = "bad \xff";
  EXPECT_TRUE(Change(store(), "a", 2, change).ok());
  EXPECT_EQ(store().GetJob("a")->report->warnings[0].message, "bad \xEF\xBF\xBD");
}

TEST_P(JobStoreConformance, KnowsNoUnknownJob) {
  EXPECT_TRUE(absl::IsNotFound(store().GetJob("a").status()));
  EXPECT_TRUE(absl::IsNotFound(store().ListEvents("a", 0, 1).status()));
  EXPECT_TRUE(absl::IsNotFound(store().ListIterations("a", 0, 1).status()));
}

TEST_P(JobStoreConformance, CreatesOnceForARequestId) {
  ASSERT_TRUE(Create(store(), "a", PlainSpec("first"), 1, "request", "digest").ok());
  ASSERT_TRUE(Append(store(), "a", 2, RecordOf(1)).ok());
  for (const bool reopen : {false, true}) {
    if (reopen) Reopen();
    const auto again = Create(store(), "b", PlainSpec("second"), 2, "request", "digest");
    ASSERT_TRUE(again.ok()) << again.status();
    EXPECT_EQ(Difference(*again, *store().GetJob("a")), "");
    const auto other = Create(store(), "c", PlainSpec(), 3, "request", "another digest");
    EXPECT_TRUE(absl::IsAlreadyExists(other.status()));
    EXPECT_EQ(ReasonOf(other.status()), "REQUEST_ID_REUSED");
  }
  EXPECT_TRUE(absl::IsNotFound(store().GetJob("b").status()));
  ASSERT_TRUE(Delete(store(), "a").ok());
  EXPECT_EQ(Create(store(), "d", PlainSpec(), 4, "request", "another digest")->id, "d");
  // Without one, every call creates.
  EXPECT_EQ(Create(store(), "e", PlainSpec(), 5)->id, "e");
  EXPECT_EQ(Create(store(), "f", PlainSpec(), 5)->id, "f");
}

// Its answer shows what was queued before it, though nothing of that was committed when the group began.
TEST_P(JobStoreConformance, AnswersARepeatedRequestAsOfItsPlace) {
  const auto ignore = [](const auto&) {};
  store().CreateJob("a", PlainSpec(), 1, "request", "digest", ignore);
  for (int i = 1; i <= 5; ++i) store().AppendIteration("a", i + 1, RecordOf(i), {}, ignore);
  JobRecord answer;
  store().CreateJob("b", PlainSpec(), 1, "request", "digest", [&](const auto& job) { answer = *job; });
  store().AppendIteration("a", 7, RecordOf(6), {}, ignore);
  store().Flush();
  EXPECT_EQ(answer.id, "a");
  EXPECT_EQ(answer.last_seq, 6);
  EXPECT_EQ(answer.completed_iterations(), 5);
  EXPECT_EQ(store().GetJob("a")->last_seq, 7);
}

TEST_P(JobStoreConformance, CreatesOnceWhenSeveralAskAtOnce) {
  constexpr int kThreads = 4;
  constexpr int kRequests = 25;
  std::vector<std::vector<std::string>> ids(kThreads);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < kThreads; ++t) {
    threads.emplace_back([&, t] {
      for (int r = 0; r < kRequests; ++r) {
        const auto job =
            Create(store(), absl::StrCat("job-", t, "-", r), PlainSpec(), 1, absl::StrCat("request-", r), "d");
        ids[t].push_back(job.ok() ? job->id : job.status().ToString());
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (std::size_t t = 1; t < kThreads; ++t) EXPECT_EQ(ids[t], ids[0]);
  JobQuery all;
  all.limit = 1000;
  EXPECT_EQ(store().ListJobs(all)->size(), kRequests);
}

TEST_P(JobStoreConformance, DeletesAJobWithAllOfIt) {
  CreateWithIterations(store(), "a", 50);
  CreateWithIterations(store(), "b", 50);
  ASSERT_TRUE(Delete(store(), "a").ok());
  EXPECT_TRUE(absl::IsNotFound(store().GetJob("a").status()));
  EXPECT_TRUE(absl::IsNotFound(store().ListEvents("a", 0, 10).status()));
  EXPECT_TRUE(absl::IsNotFound(store().ListIterations("a", 0, 10).status()));
  EXPECT_TRUE(absl::IsNotFound(Delete(store(), "a")));
  EXPECT_TRUE(absl::IsNotFound(Append(store(), "a", 52, RecordOf(51))));
  EXPECT_EQ(store().ListJobs({})->size(), 1);
  // A new job of the same name has none of the old one's history.
  ASSERT_TRUE(Create(store(), "a").ok());
  EXPECT_EQ(store().ListEvents("a", 0, 100)->size(), 1);
  EXPECT_FALSE(store().GetJob("a")->first.has_value());
  EXPECT_EQ(store().ListIterations("b", 0, 100)->size(), 50);
}

TEST_P(JobStoreConformance, CommitsWhatIsQueuedWhenItIsClosed) {
  constexpr int kCount = 3000;
  ASSERT_TRUE(Create(store(), "a").ok());
  int answered = 0;
  for (int i = 1; i <= kCount; ++i) {
    store().AppendIteration("a", i + 1, RecordOf(i), {},
                            [&answered](const absl::Status& s) { answered += s.ok() ? 1 : 0; });
  }
  Reopen();
  EXPECT_EQ(answered, kCount);
  EXPECT_EQ(store().GetJob("a")->completed_iterations(), kCount);
}

// Writers of several jobs, and readers that must find every history dense up to what was answered before they looked.
TEST_P(JobStoreConformance, ReadsAreConsistentBesideWrites) {
  constexpr int kJobs = 3;
  constexpr int kIterations = 400;
  std::array<std::atomic<int>, kJobs> answered{};
  for (int j = 0; j < kJobs; ++j) ASSERT_TRUE(Create(store(), absl::StrCat("job-", j)).ok());
  const auto write = [&](std::size_t j) {
    for (int i = 1; i <= kIterations; ++i) {
      store().AppendIteration(absl::StrCat("job-", j), i + 1, RecordOf(i), {},
                              [&answered, i, j](const absl::Status& status) {
                                EXPECT_TRUE(status.ok()) << status;
                                answered[j] = i;
                              });
      if (i % 20 == 0) store().Flush();
    }
  };
  const auto read = [&](std::size_t j) {
    for (int known = 0; known < kIterations;) {
      known = answered[j];
      const auto job = store().GetJob(absl::StrCat("job-", j));
      const auto events = store().ListEvents(absl::StrCat("job-", j), 0, 10 * kIterations);
      ASSERT_TRUE(job.ok() && events.ok()) << job.status() << events.status();
      ASSERT_GE(job->completed_iterations(), known);
      ASSERT_EQ(job->last_seq, job->completed_iterations() + 1);
      ASSERT_GE(static_cast<std::int64_t>(events->size()), job->last_seq);
      ASSERT_TRUE(
          Identical(std::get<IterationRecord>(events->back().what), RecordOf(static_cast<int>(events->size()) - 1)));
    }
  };
  std::vector<std::thread> threads;
  for (std::size_t j = 0; j < kJobs; ++j) threads.emplace_back(write, j);
  for (std::size_t j = 0; j < kJobs; ++j) {
    while (answered[j] == 0) std::this_thread::yield();
    threads.emplace_back(read, j);
  }
  for (std::thread& thread : threads) thread.join();
}

}  // namespace orbitune::storage_test
