// Plots and pages: the extremes stay, texts are escaped, every page is well-formed and needs nothing from elsewhere.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "client/cli/plot.h"
#include "client/cli/report_page.h"

namespace orbitune::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// Empty, or where the page is no XML: tags nest, attributes are quoted, & and < stand in text only as references.
std::string FaultOf(const std::string& page) {
  std::vector<std::string> open;
  std::size_t at = page.find("<html");
  for (; at < page.size(); ++at) {
    if (page[at] == '&') {
      const std::size_t end = page.find(';', at);
      if (end == std::string::npos || end - at > 6) return "a bare & at " + page.substr(at, 20);
      continue;
    }
    if (page[at] != '<') continue;
    const std::size_t end = page.find('>', at);
    if (end == std::string::npos) return "an unclosed tag";
    const std::string tag = page.substr(at + 1, end - at - 1);
    if (tag.find('<') != std::string::npos) return "a bare < in " + tag;
    if (tag[0] == '/') {
      if (open.empty() || open.back() != tag.substr(1)) return "unexpected <" + tag + ">";
      open.pop_back();
    } else {
      if (std::count(tag.begin(), tag.end(), '"') % 2 != 0) return "an unclosed quote in " + tag;
      if (tag.back() != '/') open.push_back(tag.substr(0, tag.find_first_of(" \n")));
    }
    at = end;
  }
  return open.empty() ? "" : "<" + open.back() + "> is not closed";
}

void ExpectSelfContained(const std::string& page) {
  EXPECT_EQ(FaultOf(page), "");
  for (const char* const reference : {"http:", "https:", "src=", "href=", "url(", "@import", "<script"}) {
    EXPECT_THAT(page, Not(HasSubstr(reference)));
  }
  EXPECT_THAT(page, HasSubstr("prefers-color-scheme: dark"));
  EXPECT_THAT(page, HasSubstr("@media print"));
}

std::vector<PlotPoint> Wave(int n) {
  std::vector<PlotPoint> points;
  for (int i = 0; i < n; ++i) points.push_back({1.0 * i, 2 + std::sin(0.1 * i)});
  return points;
}

TEST(Thinning, KeepsTheEndsAndTheExtremes) {
  std::vector<PlotPoint> points = Wave(100'000);
  points[31'415].y = 1000;
  points[77'777].y = -5;
  const auto thinned = Thin(points, 600);
  EXPECT_LE(thinned.size(), 610u);
  EXPECT_EQ(thinned.front().x, 0);
  EXPECT_EQ(thinned.back().x, 99'999);
  const auto has = [&](double y) {
    return std::any_of(thinned.begin(), thinned.end(), [&](const PlotPoint& p) { return p.y == y; });
  };
  EXPECT_TRUE(has(1000));
  EXPECT_TRUE(has(-5));
  EXPECT_TRUE(
      std::is_sorted(thinned.begin(), thinned.end(), [](const PlotPoint& a, const PlotPoint& b) { return a.x < b.x; }));
  EXPECT_EQ(Thin(Wave(50), 600).size(), 50u);
}

TEST(Thinning, AGapStaysAGap) {
  std::vector<PlotPoint> points = Wave(10'000);
  for (std::size_t i = 4000; i < 6000; ++i) points[i].y = std::nan("");
  const auto thinned = Thin(points, 100);
  EXPECT_TRUE(std::any_of(thinned.begin(), thinned.end(), [](const PlotPoint& p) { return std::isnan(p.y); }));
}

TEST(SvgPlot, HasAxesWithTitlesAndTicks) {
  Plot plot{.title = "a < b", .x_label = "time (h)", .y_label = "distance (km)", .log_y = true};
  plot.series.push_back({"after", "K*", {{0, 1e4}, {1, 50}, {2, 0}, {3, 1e-2}}});
  plot.levels.push_back({1, "limit", "settled"});
  const std::string svg = RenderSvg(plot);
  EXPECT_EQ(FaultOf("<html>" + svg + "</html>"), "");
  EXPECT_THAT(svg, HasSubstr("a &lt; b"));
  EXPECT_THAT(svg, HasSubstr(">time (h)<"));
  EXPECT_THAT(svg, HasSubstr("10<tspan"));
  // What a logarithm cannot show is a gap: two strokes.
  EXPECT_THAT(svg, testing::ContainsRegex("class=\"after\" d=\"M[^M]*M[^M]*\""));
}

TEST(SvgPlot, SurvivesNothingAndOneValue) {
  Plot plot{.title = "none", .x_label = "x", .y_label = "y"};
  EXPECT_THAT(RenderSvg(plot), Not(HasSubstr("nan")));
  plot.series.push_back({"after", "", {{5, 3}}});
  EXPECT_THAT(RenderSvg(plot), Not(HasSubstr("nan")));
  plot.log_y = true;
  EXPECT_THAT(RenderSvg(plot), Not(HasSubstr("nan")));
}

v1::Job SomeJob() {
  v1::Job job;
  job.set_name("jobs/a");
  job.set_display_name("<b>\"bold\"</b> & more");
  (*job.mutable_labels())["case"] = "<1>";
  job.set_state(v1::JOB_STATE_SUCCEEDED);
  job.mutable_scenario_definition()->set_settling_distance_km(10);
  job.mutable_hyperparameters()->set_algorithm(v1::ALGORITHM_ARS);
  job.mutable_report()->mutable_initial()->mutable_result()->set_cost(800);
  job.mutable_report()->mutable_final()->mutable_result()->set_cost(200);
  job.mutable_report()->mutable_final_reduction()->set_cost_percent(75);
  job.mutable_report()->add_warnings()->set_message("K2 <= floor & more");
  return job;
}

TEST(JobPageTest, HasTheFiguresAndEscapesEverything) {
  JobPageData data{.job = SomeJob()};
  for (int i = 1; i <= 3000; ++i) {
    v1::Iteration iteration;
    iteration.set_iteration(i);
    if (i != 7) iteration.set_cost(800.0 / i);
    iteration.mutable_gains()->set_k1(0.1 * i);
    data.iterations.push_back(iteration);
  }
  data.flown.push_back({"before", "K(1)", {{0, 1e4}, {100, 5}}});
  const std::string page = JobPage(data);
  ExpectSelfContained(page);
  EXPECT_THAT(page, Not(HasSubstr("<b>")));
  EXPECT_THAT(page, HasSubstr("&lt;b&gt;&quot;bold&quot;&lt;/b&gt; &amp; more"));
  EXPECT_THAT(page, HasSubstr("K2 &lt;= floor"));
  EXPECT_THAT(page, HasSubstr("75.0 %"));
  EXPECT_THAT(page, HasSubstr("Cost over iterations"));
}

TEST(CampaignPageTest, StaysSmallWithManyMembers) {
  CampaignPageData data;
  data.campaign.set_name("campaigns/c");
  data.campaign.set_state(v1::CAMPAIGN_STATE_SUCCEEDED);
  data.campaign.mutable_scenario_definition()->set_settling_distance_km(1);
  data.campaign.mutable_hyperparameters()->set_algorithm(v1::ALGORITHM_ARS);
  v1::CampaignResults& results = *data.campaign.mutable_results();
  results.mutable_mean_gains()->set_k1(1);
  results.set_conclusion("robust & <sound>");
  v1::GainsComparison& c = *results.add_comparisons();
  c.set_choice(v1::GAINS_CHOICE_MEAN);
  c.set_over(v1::MEMBER_ROLE_HELD_OUT);
  c.mutable_cost()->set_average(83.75);
  for (int i = 1; i <= 200; ++i) {
    MemberLines lines{.before = Wave(1281), .after = Wave(1281)};
    for (auto& gain : lines.gains) gain = Wave(5000);
    data.lines.push_back(std::move(lines));
    v1::CampaignMember member;
    member.set_role(v1::MEMBER_ROLE_TUNED);
    member.set_number(i);
    member.set_job("jobs/x");
    data.members.push_back(member);
  }
  const std::string page = CampaignPage(data);
  ExpectSelfContained(page);
  EXPECT_LT(page.size(), 2'000'000u);
  EXPECT_THAT(page, HasSubstr("robust &amp; &lt;sound&gt;"));
  EXPECT_THAT(page, HasSubstr("83.8"));
  EXPECT_THAT(page, HasSubstr("On held-out initial conditions"));
}

}  // namespace
}  // namespace orbitune::cli
