// What a policy removes, and what it never does.
#include "server/jobs/retention.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tests/server/engine_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kDayUs = 86'400e6;

class RetentionTest : public ::testing::Test {
 protected:
  // One pass so many days from now.
  void Pass(const RetentionPolicy& policy, double days = 0) {
    Retention retention(engine_.store(), engine_.campaign_engine(), directory_.File("orbitune.db"), policy,
                        [this](const std::string& line) { log_.push_back(line); });
    retention.Pass(NowUs() + static_cast<TimeUs>(days * kDayUs));
  }
  bool Exists(const std::string& id) { return engine_.store().GetJob(id).ok(); }
  bool HasHistory(const std::string& id) { return engine_.store().ListIterations(id, 0, 1).ok(); }
  std::string Ended(int iterations = 20) {
    const std::string id = engine_.Create(SmallScenario(iterations));
    EXPECT_EQ(engine_.WaitForEnd(id).state, JobState::kSucceeded);
    return id;
  }
  std::string EndedCampaign() {
    CampaignRequest request;
    request.job.scenario.definition = SmallScenario(20);
    request.initial_conditions.draw.emplace();
    request.initial_conditions.draw->count = 2;
    const auto campaign = engine_.campaigns().Create(request, "", false);
    EXPECT_TRUE(campaign.ok()) << campaign.status();
    while (!IsTerminal(engine_.campaigns().Get(campaign->id)->state)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return campaign->id;
  }

  TemporaryDirectory directory_;
  Engine engine_{directory_.File("orbitune.db")};
  std::vector<std::string> log_;
};

TEST_F(RetentionTest, IsOffByDefault) {
  const std::string job = Ended();
  EXPECT_TRUE(RetentionPolicy().off());
  Pass({}, 1e5);
  EXPECT_TRUE(HasHistory(job));
  EXPECT_THAT(log_, IsEmpty());
}

TEST_F(RetentionTest, RemovesByAgeAndNeverWhatHasNotEndedOrGainSets) {
  const std::string ended = Ended();
  const std::string running = engine_.Create(EndlessScenario());
  engine_.WaitForIterations(running, 10);
  const RetentionPolicy policy{.jobs_days = 30, .iterations_days = 7};
  Pass(policy, 6.9);
  EXPECT_TRUE(HasHistory(ended));
  Pass(policy, 7.1);
  EXPECT_FALSE(HasHistory(ended));
  EXPECT_EQ(engine_.Get(ended).completed_iterations(), 20);
  Pass(policy, 29.9);
  EXPECT_TRUE(Exists(ended));
  Pass(policy, 1000);
  EXPECT_FALSE(Exists(ended));
  EXPECT_TRUE(engine_.store().gains().GetGainSet(ended).ok());
  EXPECT_TRUE(HasHistory(running));
  EXPECT_THAT(log_, Contains(HasSubstr("the iterations of jobs " + ended)));
  EXPECT_THAT(log_, Contains(HasSubstr("removed jobs " + ended)));
}

TEST_F(RetentionTest, ACampaignGoesAsAWhole) {
  const std::string campaign = EndedCampaign();
  const auto members = *engine_.store().campaigns().ListMembers(campaign, {}, 10);
  Pass({.jobs_days = 1}, 100);
  EXPECT_TRUE(Exists(members[0].job_id));
  Pass({.iterations_days = 1}, 100);
  EXPECT_FALSE(HasHistory(members[0].job_id));
  EXPECT_TRUE(engine_.campaigns().ListMembers(campaign, 10, "").ok());
  Pass({.campaigns_days = 1}, 100);
  EXPECT_TRUE(absl::IsNotFound(engine_.campaigns().Get(campaign).status()));
  EXPECT_FALSE(Exists(members[0].job_id));
}

TEST_F(RetentionTest, BySizeTheOldestGoesFirstAndOnlyWhatMust) {
  std::vector<std::string> jobs;
  for (int i = 0; i < 12; ++i) jobs.push_back(Ended(2000));
  const auto bytes = engine_.store().retention().GetUsage()->bytes;
  Pass({.max_database_bytes = bytes});
  EXPECT_THAT(log_, IsEmpty());
  // The histories are most of it: those of the first eight make room for this.
  Pass({.max_database_bytes = bytes * 3 / 4});
  EXPECT_LE(engine_.store().retention().GetUsage()->bytes, bytes * 3 / 4);
  EXPECT_FALSE(HasHistory(jobs.front()));
  EXPECT_TRUE(HasHistory(jobs.back()));
  EXPECT_TRUE(Exists(jobs.front()));
  // What nothing can reach is told, and stays so; gain sets stay.
  Pass({.max_database_bytes = 1000});
  for (const std::string& job : jobs) {
    EXPECT_FALSE(Exists(job));
    EXPECT_TRUE(engine_.store().gains().GetGainSet(job).ok());
  }
  EXPECT_THAT(log_.back(), HasSubstr("nothing is left that may be removed"));
}

TEST_F(RetentionTest, TheNewestBackupStays) {
  std::vector<std::string> paths;
  for (const char* name : {"orbitune-schema1-a.db", "orbitune-schema3-b.db", "orbitune-schema4-c.db", "mine.db"}) {
    paths.push_back(directory_.File(name));
    std::ofstream(paths.back()) << "x";
    std::filesystem::last_write_time(
        paths.back(), std::filesystem::file_time_type::clock::now() - std::chrono::hours(1000 - 10 * paths.size()));
  }
  Pass({.backups_days = 100});
  EXPECT_TRUE(std::filesystem::exists(paths[0]));
  Pass({.backups_days = 30});
  EXPECT_FALSE(std::filesystem::exists(paths[0]));
  EXPECT_FALSE(std::filesystem::exists(paths[1]));
  EXPECT_TRUE(std::filesystem::exists(paths[2]));
  EXPECT_TRUE(std::filesystem::exists(paths[3]));
  EXPECT_THAT(log_, SizeIs(2));
}

}  // namespace
}  // namespace orbitune::server_test
