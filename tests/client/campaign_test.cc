// Campaigns on the command line: initial conditions from files, tables out.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <sstream>

#include "client/cli/campaign_csv.h"
#include "client/cli/campaign_text.h"
#include "client/cli/initial_condition_file.h"

namespace orbitune::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

std::string ErrorOf(const std::string& csv) {
  const auto parsed = ParseInitialConditionsCsv(csv);
  EXPECT_FALSE(parsed.ok());
  return std::string(parsed.status().message());
}

TEST(InitialConditionCsv, HasAColumnForEachElementInAnyOrder) {
  const auto parsed = ParseInitialConditionsCsv(
      "\xef\xbb\xbf"
      "eccentricity, semi_major_axis_km,inclination_deg,raan_deg,argument_of_periapsis_deg,true_longitude_deg\r\n"
      "0.73,24364,63,75,158,30\r\n"
      "\r\n"
      "0.5,2e4,10,0,0,-30.5\r\n");
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  ASSERT_EQ(parsed->list().size(), 2);
  EXPECT_EQ(parsed->list(0).keplerian().semi_major_axis_km(), 24364);
  EXPECT_EQ(parsed->list(1).keplerian().true_longitude_deg(), -30.5);
}

TEST(InitialConditionCsv, FaultsTellLineAndColumn) {
  EXPECT_THAT(ErrorOf("p_km,ex,ey,hx,hy,longitude\n"), HasSubstr("line 1: 'longitude'"));
  EXPECT_THAT(ErrorOf("p_km,ex,ey,hx,hy,true_longitude_deg\n1,2,3,4,5\n"), HasSubstr("line 2: 5 values"));
  EXPECT_THAT(ErrorOf("p_km,ex,ey,hx,hy,true_longitude_deg\n1,2,3,4,x,6\n"), HasSubstr("line 2: hy"));
  EXPECT_THAT(ErrorOf("p_km,ex,ey,hx\n1,2,3,4\n"), HasSubstr("lacks hy, true_longitude_deg"));
  EXPECT_THAT(ErrorOf("p_km,ex,ey,hx,hy,true_longitude_deg\n"), HasSubstr("no initial conditions"));
}

v1::CampaignMember Member(v1::MemberRole role, int number) {
  v1::CampaignMember member;
  member.set_role(role);
  member.set_number(number);
  member.set_job("jobs/a");
  member.set_job_state(v1::JOB_STATE_SUCCEEDED);
  v1::EquinoctialElements& state = *member.mutable_initial_condition()->mutable_equinoctial();
  state.set_p_km(7378.1370000000001 + number);
  state.set_true_longitude_deg(0.1);
  for (const auto& [choice, cost] : {std::pair{v1::GAINS_CHOICE_INITIAL, 800.0}, {v1::GAINS_CHOICE_TUNED, 200.5}}) {
    v1::MemberEpisode& episode = *member.add_episodes();
    episode.set_choice(choice);
    episode.mutable_gains()->set_k1(0.1);
    episode.set_outcome(v1::OUTCOME_SETTLED);
    episode.set_cost(cost);
    episode.set_settling_time_s(7200);
    episode.set_cost_reduction_percent(100 * (1 - cost / 800));
  }
  return member;
}

TEST(CampaignCsvTest, WhatIsExportedCanBeReadAgain) {
  const std::vector<v1::CampaignMember> members = {Member(v1::MEMBER_ROLE_TUNED, 1), Member(v1::MEMBER_ROLE_TUNED, 2),
                                                   Member(v1::MEMBER_ROLE_HELD_OUT, 1)};
  const std::string csv = CampaignCsv(members);
  EXPECT_THAT(csv, HasSubstr("role,number,job,job_state,p_km,ex,"));
  EXPECT_THAT(csv, Not(HasSubstr("semi_major_axis_km")));
  EXPECT_THAT(csv, HasSubstr("\ntuned,2,jobs/a,SUCCEEDED,7380.137,"));
  const auto parsed = ParseInitialConditionsCsv(csv);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  ASSERT_EQ(parsed->list().size(), 2);  // those held out are not to be tuned for
  EXPECT_EQ(parsed->list(1).SerializeAsString(), members[1].initial_condition().SerializeAsString());
}

TEST(CampaignText, AMemberIsALine) {
  v1::CampaignProgress progress;
  progress.mutable_tuned()->set_members(50);
  EXPECT_EQ(
      MemberLine(Member(v1::MEMBER_ROLE_TUNED, 7), progress),
      "initial condition 7/50  SUCCEEDED  J 800 -> 200.5  reduction 74.9 %  settles in 2 h  K 0.1 0 0 0 0  jobs/a");
  v1::CampaignMember failed;
  failed.set_role(v1::MEMBER_ROLE_TUNED);
  failed.set_number(1);
  failed.set_job("jobs/b");
  failed.set_job_state(v1::JOB_STATE_FAILED);
  failed.set_error_message("left the \x1b domain");
  EXPECT_EQ(MemberLine(failed, progress), "initial condition 1/50  FAILED  jobs/b  left the ? domain");
}

TEST(CampaignText, TheTablesAreThePapers) {
  v1::CampaignResults results;
  results.set_mean_of(2);
  results.mutable_mean_gains()->set_k1(0.5);
  v1::GainsComparison& c = *results.add_comparisons();
  c.set_choice(v1::GAINS_CHOICE_MEAN);
  c.set_over(v1::MEMBER_ROLE_TUNED);
  c.set_flown(2);
  c.set_settled(1);
  c.mutable_cost()->set_average(78.44);
  c.mutable_cost()->set_minimum(68.9);
  c.mutable_cost()->set_maximum(85.9);
  c.mutable_fuel_sum()->set_average(std::nan(""));
  results.set_conclusion("K-hat it is.");
  std::ostringstream out;
  PrintResults(results, out);
  EXPECT_THAT(out.str(), HasSubstr("2 tuned initial conditions"));
  EXPECT_THAT(out.str(), HasSubstr("1/2"));
  EXPECT_THAT(out.str(), testing::ContainsRegex("78\\.4 +68\\.9 +85\\.9"));
  EXPECT_THAT(out.str(), HasSubstr("K-hat it is."));
}

}  // namespace
}  // namespace orbitune::cli
