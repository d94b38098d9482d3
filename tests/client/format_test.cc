#include "client/cli/format.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <sstream>

#include "client/cli/csv.h"
#include "client/cli/parse.h"
#include "client/cli/progress.h"
#include "client/cli/table.h"

namespace orbitune::cli {
namespace {

TEST(Format, CsvNumbersRoundTripAndAreShort) {
  EXPECT_EQ(RoundTrip(0.1), "0.1");
  EXPECT_EQ(RoundTrip(1.0 / 3), "0.3333333333333333");
  for (const double value : {812.62812345678901, 1e-300, -std::numeric_limits<double>::max(), 0.1 + 0.2}) {
    EXPECT_EQ(std::stod(RoundTrip(value)), value);
  }
}

TEST(Format, ForPeople) {
  EXPECT_EQ(Human(640.12345678), "640.123");
  EXPECT_EQ(Human(std::nullopt), "-");
  EXPECT_EQ(Percent(21.234), "21.2 %");
  EXPECT_EQ(Percent(ReductionPercent(200, 50)), "75.0 %");
  EXPECT_FALSE(ReductionPercent(0, 50).has_value());
  EXPECT_EQ(HumanDuration(0.25), "250 ms");
  EXPECT_EQ(HumanDuration(12.34), "12.3 s");
  EXPECT_EQ(HumanDuration(125), "2 min 5 s");
  EXPECT_EQ(HumanDuration(3600 * 3 + 60 * 12), "3 h 12 min");
  google::protobuf::Timestamp time;
  time.set_seconds(1714564800);
  EXPECT_EQ(UtcTime(time), "2024-05-01T12:00:00Z");
  EXPECT_EQ(OutcomeText(v1::OUTCOME_NOT_SETTLED), "not settled");
  EXPECT_EQ(StateText(static_cast<v1::JobState>(99)), "99");  // of a newer server
  EXPECT_EQ(Printable("a\x1b[2J\nb"), "a?[2J?b");
}

TEST(Csv, IterationRow) {
  v1::Iteration iteration;
  iteration.set_iteration(12);
  iteration.set_cost(0.1);
  iteration.set_settling_samples(30);
  iteration.set_fuel_sum(2.5);
  iteration.set_outcome(v1::OUTCOME_NOT_SETTLED);
  iteration.mutable_gains()->set_k1(1e-3);
  iteration.set_cost_std(1.0 / 3);
  iteration.set_pairs_left_out(2);
  iteration.set_episodes(396);
  EXPECT_EQ(IterationCsvHeader(),
            "iteration,cost,settling_samples,fuel_sum,outcome,k1,k2,k3,k4,k5,cost_std,pairs_left_out,pairs_not_settled,"
            "episodes");
  EXPECT_EQ(IterationCsvRow(iteration), "12,0.1,30,2.5,NOT_SETTLED,0.001,0,0,0,0,0.3333333333333333,2,0,396");
  iteration.clear_cost();
  EXPECT_EQ(IterationCsvRow(iteration).rfind("12,,30,", 0), 0u);
}

TEST(Csv, TrajectoryRowHasAFieldPerTitle) {
  const auto commas = [](const std::string& line) { return std::count(line.begin(), line.end(), ','); };
  v1::TrajectorySample sample;
  sample.mutable_error()->set_x6(6);
  sample.mutable_control()->set_radial_m_s2(7);
  EXPECT_EQ(TrajectoryCsvRow(sample), "0,0,0,0,0,0,0,0,0,0,0,0,0,6,7,0,0,0,0");
  EXPECT_EQ(commas(TrajectoryCsvRow(sample)), commas(TrajectoryCsvHeader()));
}

TEST(Table, AlignsByCharacters) {
  Table table({"NAME", ">J", "TITLE"});
  table.AddRow({"jobs/ä", "1.5", "x"});
  table.AddRow({"jobs/abc", "12", ""});
  std::ostringstream out;
  table.Print(out);
  EXPECT_EQ(out.str(), "NAME        J  TITLE\njobs/ä    1.5  x\njobs/abc   12\n");
}

v1::Job RunningJob() {
  v1::Job job;
  job.set_state(v1::JOB_STATE_RUNNING);
  job.mutable_hyperparameters()->set_iterations(2000);
  job.set_completed_iterations(500);
  job.mutable_initial_iteration()->set_cost(800);
  v1::Iteration& latest = *job.mutable_latest_iteration();
  latest.set_iteration(500);
  latest.set_cost(200);
  latest.set_outcome(v1::OUTCOME_SETTLED);
  *latest.mutable_gains() = *ParseGains("0.125,1,2,3,10");
  return job;
}

TEST(Progress, WideLineTellsAll) {
  EXPECT_EQ(ProgressLine(RunningJob(), 100, 200),
            "[#####...............]  500/2000  J 200 (-75.0 %)  K 0.125 1 2 3 10  100 it/s  15 s left");
}

TEST(Progress, FitsEveryWidthAndDropsTheGainsFirst) {
  const v1::Job job = RunningJob();
  bool gains_gone = false;
  for (int width = 120; width >= 0; --width) {
    const std::string line = ProgressLine(job, 100, width);
    EXPECT_LE(line.size(), static_cast<std::size_t>(width));
    gains_gone = gains_gone || line.find("K 0.125") == std::string::npos;
    EXPECT_TRUE(gains_gone || line.find("15 s left") != std::string::npos) << width;
  }
  EXPECT_TRUE(gains_gone);
  EXPECT_NE(ProgressLine(job, 100, 80).find("K 0.125 1 2 3 10"), std::string::npos) << ProgressLine(job, 100, 80);
  EXPECT_NE(ProgressLine(job, 100, 75).find("K 0.125 1 ...  100 it/s  15 s left"), std::string::npos)
      << ProgressLine(job, 100, 75);
  EXPECT_NE(ProgressLine(job, 100, 40).find("500/2000  J 200"), std::string::npos);
}

TEST(Progress, BeforeTheFirstIteration) {
  v1::Job job;
  job.set_state(v1::JOB_STATE_QUEUED);
  job.mutable_hyperparameters()->set_iterations(10);
  EXPECT_EQ(ProgressLine(job, std::nullopt, 80), "[..........]  QUEUED  0/10");
}

TEST(Progress, PlainLine) {
  const v1::Job job = RunningJob();
  EXPECT_EQ(IterationLine(job.latest_iteration(), job),
            "iteration 500/2000  J 200  reduction 75.0 %  K 0.125 1 2 3 10");
  v1::Iteration lost = job.latest_iteration();
  lost.clear_cost();
  lost.set_outcome(v1::OUTCOME_LEFT_DOMAIN);
  EXPECT_EQ(IterationLine(lost, job), "iteration 500/2000  J -  reduction -  K 0.125 1 2 3 10  left the domain");
}

TEST(RateMeter, CountsTheLastSeconds) {
  RateMeter meter;
  meter.Add(0, 0);
  EXPECT_FALSE(meter.PerSecond().has_value());
  for (int i = 1; i <= 1000; ++i) meter.Add(0.01 * i, i);
  EXPECT_NEAR(*meter.PerSecond(), 100, 1);
  for (int i = 1; i <= 1000; ++i) meter.Add(10 + 0.1 * i, 1000 + i);
  EXPECT_NEAR(*meter.PerSecond(), 10, 0.1);
}

}  // namespace
}  // namespace orbitune::cli
