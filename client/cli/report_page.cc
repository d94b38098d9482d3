#include "client/cli/report_page.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/cli/campaign_text.h"
#include "client/cli/fields.h"
#include "client/cli/format.h"

namespace orbitune::cli {
namespace {

constexpr std::size_t kMostMemberRows = 1000;
// Costs that differ by more are drawn on a logarithmic axis.
constexpr double kLogarithmicFrom = 20;

constexpr char kStyle[] = R"css(
:root { --text: #1b1f24; --soft: #5b6470; --page: #ffffff; --line: #d9dee4; --grid: #e8ecf0; --before: #8a939e;
  --after: #c4342b; --best: #1f6fb4; --mean: #c58a00; --robust: #18865a; --k1: #1f6fb4; --k2: #c4342b; --k3: #18865a;
  --k4: #a4559c; --k5: #c58a00; }
@media (prefers-color-scheme: dark) { :root { --text: #e6e9ed; --soft: #9aa4b0; --page: #14171b; --line: #39414b;
  --grid: #262c33; --before: #7b8590; --after: #ff7468; --best: #6db3f2; --mean: #f0b93a; --robust: #4cc38e;
  --k1: #6db3f2; --k2: #ff7468; --k3: #4cc38e; --k4: #d991d1; --k5: #f0b93a; } }
@media print { :root { --text: #000; --soft: #444; --page: #fff; --line: #bbb; --grid: #e4e4e4; --before: #999;
  --after: #b02a22; --best: #1f6fb4; --mean: #b07c00; --robust: #18865a; --k1: #1f6fb4; --k2: #b02a22; --k3: #18865a;
  --k4: #a4559c; --k5: #b07c00; } }
html { background: var(--page); color: var(--text); font: 15px/1.5 system-ui, sans-serif; }
body { max-width: 960px; margin: 0 auto; padding: 1.5rem 1rem 3rem; }
h1 { font-size: 1.5rem; margin: 0 0 .3rem; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem; border-bottom: 1px solid var(--line); padding-bottom: .2rem; }
p.soft, figcaption, footer { color: var(--soft); }
figure { margin: 1rem 0 1.6rem; break-inside: avoid; }
figcaption { font-size: .9rem; }
svg { display: block; width: 100%; height: auto; font: 11px system-ui, sans-serif; }
svg text { fill: var(--text); }
svg path, svg line { fill: none; stroke-width: 1.4; stroke-linejoin: round; }
svg .grid { stroke: var(--grid); stroke-width: 1; }
svg .axis { stroke: var(--soft); stroke-width: 1; }
svg .before { stroke: var(--before); } svg .after { stroke: var(--after); } svg .best { stroke: var(--best); }
svg .mean { stroke: var(--mean); stroke-width: 2; } svg .robust { stroke: var(--robust); stroke-width: 2; }
svg .limit { stroke: var(--soft); stroke-dasharray: 5 4; }
svg path.many { stroke-width: .8; opacity: .55; }
svg .k1 { stroke: var(--k1); } svg .k2 { stroke: var(--k2); } svg .k3 { stroke: var(--k3); }
svg .k4 { stroke: var(--k4); } svg .k5 { stroke: var(--k5); }
div.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; margin: .5rem 0 1rem; }
th, td { padding: .2rem .6rem; border-bottom: 1px solid var(--line); text-align: right; white-space: nowrap; }
th:first-child, td:first-child, table.plain td { text-align: left; }
th:first-child, td:first-child { padding-left: 0; }
thead th { color: var(--soft); font-weight: 600; }
tr { break-inside: avoid; }
pre { font-size: .82rem; overflow-x: auto; }
.warning { border-left: 3px solid var(--mean); padding-left: .7rem; }
.conclusion { border-left: 3px solid var(--best); padding-left: .7rem; }
@media print { body { max-width: none; padding: 0; font-size: 11pt; } div.scroll { overflow: visible; }
  table { font-size: 8pt; } details { display: none; } }
)css";

class Page {
 public:
  explicit Page(const std::string& title) {
    html_ = absl::StrCat(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n<meta name=\"viewport\" "
        "content=\"width=device-width, initial-scale=1\"/>\n<meta name=\"color-scheme\" content=\"light "
        "dark\"/>\n<title>",
        EscapeXml(title), "</title>\n<style>", kStyle, "</style>\n</head>\n<body>\n<h1>", EscapeXml(title), "</h1>\n");
  }

  void Heading(const std::string& text) { absl::StrAppend(&html_, "<h2>", EscapeXml(text), "</h2>\n"); }

  void Paragraph(const std::string& text, const std::string& style = "") {
    absl::StrAppend(&html_, "<p", style.empty() ? "" : absl::StrCat(" class=\"", style, "\""), ">", EscapeXml(text),
                    "</p>\n");
  }

  void Figure(const Plot& plot, const std::string& caption, int points_per_line = 600) {
    absl::StrAppend(&html_, "<figure>\n", RenderSvg(plot, points_per_line), "<figcaption>", EscapeXml(caption),
                    "</figcaption>\n</figure>\n");
  }

  void Table(const std::vector<std::string>& titles, const std::vector<std::vector<std::string>>& rows) {
    absl::StrAppend(&html_, "<div class=\"scroll\"><table", titles.empty() ? " class=\"plain\"" : "", ">\n");
    if (!titles.empty()) absl::StrAppend(&html_, "<thead>", Row(titles, "th"), "</thead>\n");
    html_ += "<tbody>\n";
    for (const auto& row : rows) html_ += Row(row, "td");
    html_ += "</tbody></table></div>\n";
  }

  // A message field by field, folded away.
  void Details(const std::string& title, const google::protobuf::Message& message) {
    std::ostringstream text;
    PrintFields(message, 0, text);
    absl::StrAppend(&html_, "<details><summary>", EscapeXml(title), "</summary><pre>");
    for (const absl::string_view line : absl::StrSplit(text.str(), '\n')) {
      absl::StrAppend(&html_, EscapeXml(std::string(line)), "\n");
    }
    html_ += "</pre></details>\n";
  }

  std::string Finish() {
    absl::StrAppend(&html_, "<footer><p>Written by orbitune ", ORBITUNE_VERSION, ".</p></footer>\n</body>\n</html>\n");
    return std::move(html_);
  }

 private:
  static std::string Row(const std::vector<std::string>& cells, const char* tag) {
    std::string row = "<tr>";
    for (const std::string& cell : cells) absl::StrAppend(&row, "<", tag, ">", EscapeXml(cell), "</", tag, ">");
    return row + "</tr>\n";
  }

  std::string html_;
};

std::array<double, 5> ToArray(const v1::Gains& k) { return {k.k1(), k.k2(), k.k3(), k.k4(), k.k5()}; }

std::string GainTitle(std::size_t i) { return absl::StrCat("K", i + 1); }

std::string Tenths(double percent) { return std::isnan(percent) ? "-" : absl::StrFormat("%.1f", percent); }

// A little beyond where the last of the lines comes down to the settling distance for good.
double EndOf(const std::vector<const std::vector<PlotPoint>*>& lines, double settling_distance_km) {
  double end = 0;
  for (const auto* const line : lines) {
    for (const PlotPoint& p : *line) {
      if (p.y > settling_distance_km) end = std::max(end, p.x);
    }
  }
  return end > 0 ? 1.15 * end : 1;
}

Plot DistancePlot(const std::string& title, double settling_distance_km) {
  Plot plot{.title = title, .x_label = "time (h)", .y_label = "distance (km)", .log_y = true};
  plot.levels.push_back({settling_distance_km, "limit", absl::StrCat("settled: ", Human(settling_distance_km), " km")});
  plot.height = 340;
  return plot;
}

Plot FlownPlot(const std::vector<FlownGains>& flown, double settling_distance_km) {
  Plot plot = DistancePlot("Distance to the target over time", settling_distance_km);
  std::vector<const std::vector<PlotPoint>*> lines;
  for (const FlownGains& gains : flown) {
    plot.series.push_back({gains.style, gains.title, gains.distance});
    lines.push_back(&gains.distance);
  }
  plot.x_end = EndOf(lines, settling_distance_km);
  return plot;
}

// ---- jobs

void AddDigests(const v1::Provenance& provenance, std::vector<std::vector<std::string>>& rows) {
  if (provenance.digest().empty()) return;
  rows.push_back({"scenario digest", provenance.scenario_digest()});
  rows.push_back({"inputs digest", provenance.inputs_digest()});
  rows.push_back({absl::StrCat("history digest, ", provenance.iterations(), " iterations"), provenance.digest()});
  for (const v1::Engine& engine : provenance.engines()) {
    rows.push_back({absl::StrCat("engine, from iteration ", engine.first_iteration()), EngineText(engine)});
  }
}

void AddJobProvenance(const v1::Job& job, Page& page) {
  std::vector<std::vector<std::string>> rows = {
      {"job", job.name()}, {"state", StateText(job.state())}, {"scenario", job.scenario()}};
  if (!job.campaign().empty()) rows.push_back({"campaign", job.campaign()});
  rows.push_back({"search", absl::StrCat(v1::Algorithm_Name(job.hyperparameters().algorithm()).substr(10), ", seed ",
                                         job.hyperparameters().seed())});
  rows.push_back({"iterations", absl::StrCat(job.completed_iterations(), " of ", job.hyperparameters().iterations())});
  if (job.has_report()) rows.push_back({"episodes flown", absl::StrCat(job.report().episodes())});
  rows.push_back({"created", UtcTime(job.create_time())});
  if (job.has_end_time()) rows.push_back({"ended", UtcTime(job.end_time())});
  for (const auto& [key, value] : job.labels()) rows.push_back({absl::StrCat("label ", key), value});
  AddDigests(job.provenance(), rows);
  page.Heading("Provenance");
  page.Table({}, rows);
  page.Details("hyperparameters", job.hyperparameters());
  page.Details("scenario", job.scenario_definition());
  if (job.has_initial_condition()) page.Details("initial condition", job.initial_condition());
}

void AddComparison(const v1::JobReport& report, Page& page) {
  std::vector<std::vector<std::string>> rows;
  const auto add = [&](const std::string& title, double (*value)(const v1::EpisodeResult&),
                       double (*reduction)(const v1::Reduction&)) {
    std::vector<std::string> row = {title};
    const bool baseline = report.initial().result().has_cost();
    row.push_back(baseline ? Human(value(report.initial().result())) : "-");
    for (const auto& [assessed, reduced] :
         {std::pair{&report.final(), &report.final_reduction()}, std::pair{&report.best(), &report.best_reduction()}}) {
      const bool has = assessed->result().has_cost();
      row.push_back(has ? Human(value(assessed->result())) : "-");
      row.push_back(has && baseline ? Percent(reduction(*reduced)) : "-");
    }
    rows.push_back(std::move(row));
  };
  using R = v1::EpisodeResult;
  using D = v1::Reduction;
  add(
      "cost J", [](const R& r) { return r.cost(); }, [](const D& d) { return d.cost_percent(); });
  add(
      "settling time (h)", [](const R& r) { return r.settling_time_s() / 3600; },
      [](const D& d) { return d.settling_time_percent(); });
  add(
      "fuel sum", [](const R& r) { return r.fuel_sum(); }, [](const D& d) { return d.fuel_sum_percent(); });
  add(
      "true delta-v to settling (m/s)", [](const R& r) { return r.delta_v_to_settling_m_s(); },
      [](const D& d) { return d.delta_v_percent(); });
  add(
      "peak acceleration (m/s²)", [](const R& r) { return r.peak_acceleration_m_s2(); },
      [](const D& d) { return d.peak_acceleration_percent(); });
  rows.push_back({"episode", OutcomeText(report.initial().result().outcome()),
                  OutcomeText(report.final().result().outcome()), "", OutcomeText(report.best().result().outcome()),
                  ""});
  page.Table({"", "K(1)", absl::StrCat("K(", report.final().iteration(), ")"), "less by",
              absl::StrCat("best K (iteration ", report.best().iteration(), ")"), "less by"},
             rows);
  page.Table({"gains", "K1", "K2", "K3", "K4", "K5"}, [&] {
    std::vector<std::vector<std::string>> gains;
    for (const auto& [title, assessed] : {std::pair{"K(1)", &report.initial()}, std::pair{"last", &report.final()},
                                          std::pair{"best", &report.best()}}) {
      std::vector<std::string> row = {title};
      for (const double k : ToArray(assessed->gains())) row.push_back(Human(k));
      gains.push_back(std::move(row));
    }
    return gains;
  }());
}

void AddSearchFigures(const JobPageData& data, Page& page) {
  Plot gains{.title = "Gains over iterations", .x_label = "iteration", .y_label = "gain", .log_y = true};
  Plot cost{.title = "Cost over iterations", .x_label = "iteration", .y_label = "cost J"};
  for (std::size_t i = 0; i < 5; ++i) gains.series.push_back({absl::StrCat("k", i + 1), GainTitle(i), {}});
  PlotSeries costs{.style = "after", .title = "J of the iteration"};
  PlotSeries best{.style = "best", .title = "the best so far"};
  double least = std::numeric_limits<double>::infinity();
  double greatest = 0;
  for (const v1::Iteration& iteration : data.iterations) {
    const double x = iteration.iteration();
    const auto k = ToArray(iteration.gains());
    for (std::size_t i = 0; i < 5; ++i) gains.series[i].points.push_back({x, k[i]});
    const double j = iteration.has_cost() ? iteration.cost() : std::nan("");
    costs.points.push_back({x, j});
    if (!std::isnan(j)) {
      greatest = std::max(greatest, j);
      least = std::min(least, j);
    }
    best.points.push_back({x, std::isinf(least) ? std::nan("") : least});
  }
  cost.log_y = greatest > kLogarithmicFrom * least;
  cost.series = {best, costs};
  page.Heading("The search");
  page.Figure(gains, "The gains K over the iterations.");
  page.Figure(cost, "The cost J over the iterations.");
}

// ---- campaigns

std::string SourceText(const v1::InitialConditions& source, int members) {
  if (members == 0) return "none";
  if (!source.has_draw()) return absl::StrCat(members, ", listed");
  return absl::StrCat(members, ", ", source.draw().count(), " of them drawn with seed ", source.draw().seed());
}

void AddCampaignProvenance(const v1::Campaign& campaign, Page& page) {
  const v1::CampaignProgress& progress = campaign.progress();
  std::vector<std::vector<std::string>> rows = {
      {"campaign", campaign.name()},
      {"state", CampaignStateText(campaign.state())},
      {"scenario", campaign.scenario()},
      {"initial conditions tuned for", SourceText(campaign.initial_conditions(), progress.tuned().members())},
      {"held out", SourceText(campaign.held_out(), progress.held_out().members())},
      {"jobs that succeeded",
       absl::StrCat(progress.tuned().succeeded() + progress.held_out().succeeded() + progress.robust().succeeded(),
                    " of ", progress.tuned().jobs() + progress.held_out().jobs() + progress.robust().jobs())},
      {"search",
       absl::StrCat(v1::Algorithm_Name(campaign.hyperparameters().algorithm()).substr(10), ", seed ",
                    campaign.hyperparameters().seed(), ", ", campaign.hyperparameters().iterations(), " iterations")}};
  if (campaign.has_results()) rows.push_back({"episodes flown", absl::StrCat(campaign.results().episodes())});
  rows.push_back({"created", UtcTime(campaign.create_time())});
  if (campaign.has_end_time()) rows.push_back({"ended", UtcTime(campaign.end_time())});
  for (const auto& [key, value] : campaign.labels()) rows.push_back({absl::StrCat("label ", key), value});
  page.Heading("Provenance");
  page.Table({}, rows);
  page.Details("hyperparameters", campaign.hyperparameters());
  page.Details("scenario", campaign.scenario_definition());
  if (campaign.has_initial_conditions()) page.Details("draws", campaign.initial_conditions());
  if (campaign.has_robust()) page.Details("robust tuning", campaign.robust());
}

void AddReductions(const v1::CampaignResults& results, v1::MemberRole over, const std::string& title, Page& page) {
  std::vector<std::vector<std::string>> reductions, percentiles;
  for (const v1::GainsComparison& c : results.comparisons()) {
    if (c.over() != over || c.choice() == v1::GAINS_CHOICE_INITIAL) continue;
    std::vector<std::string> row = {ChoiceText(c.choice()), absl::StrCat(c.settled(), "/", c.flown())};
    for (const auto* const s : {&c.cost(), &c.settling_time(), &c.fuel_sum()}) {
      for (const double value : {s->average(), s->minimum(), s->maximum()}) row.push_back(Tenths(value));
    }
    row.push_back(Tenths(c.delta_v().average()));
    reductions.push_back(std::move(row));
    const v1::ReductionStatistics& s = c.cost();
    percentiles.push_back({ChoiceText(c.choice()), Tenths(s.percentile_5()), Tenths(s.percentile_25()),
                           Tenths(s.percentile_50()), Tenths(s.percentile_75()), Tenths(s.percentile_95())});
  }
  if (reductions.empty()) return;
  page.Heading(title);
  page.Paragraph("Reductions in percent of the value under K(1).", "soft");
  page.Table({"", "settled", "cost: avg", "min", "max", "settling: avg", "min", "max", "fuel: avg", "min", "max",
              "delta-v: avg"},
             reductions);
  page.Table({"cost, percentiles", "5", "25", "50", "75", "95"}, percentiles);
}

void AddResults(const v1::CampaignResults& results, Page& page) {
  page.Paragraph(results.conclusion(), "conclusion");
  std::vector<std::vector<std::string>> gains;
  const auto add = [&](const std::string& title, const v1::Gains& k) {
    std::vector<std::string> row = {title};
    for (const double gain : ToArray(k)) row.push_back(Human(gain));
    gains.push_back(std::move(row));
  };
  add(absl::StrCat("K-hat, mean over ", results.mean_of()), results.mean_gains());
  if (results.has_robust_gains()) add("robust K", results.robust_gains());
  page.Table({"gains", "K1", "K2", "K3", "K4", "K5"}, gains);
  AddReductions(results, v1::MEMBER_ROLE_TUNED, "On the initial conditions tuned for", page);
  AddReductions(results, v1::MEMBER_ROLE_HELD_OUT, "On held-out initial conditions", page);
}

void AddTrajectories(const CampaignPageData& data, Page& page) {
  const double settled_km = data.campaign.scenario_definition().settling_distance_km();
  Plot plot = DistancePlot("Distance to the target over time, all initial conditions", settled_km);
  std::vector<const std::vector<PlotPoint>*> lines;
  for (const MemberLines& member : data.lines) {
    plot.series.push_back({"before many", lines.empty() ? "under K(1)" : "", member.before});
    lines.push_back(&member.before);
  }
  for (bool first = true; const MemberLines& member : data.lines) {
    plot.series.push_back({"after many", first ? "under K*" : "", member.after});
    first = false;
  }
  plot.x_end = EndOf(lines, settled_km);
  plot.height = 380;
  page.Figure(plot,
              absl::StrCat("Distance to the target over time, of ", data.lines.size(),
                           " initial conditions: before (grey) and after (coloured) each was tuned for."),
              DistancePointsPerLine(data.lines.size()));
  if (data.flown.empty()) return;
  page.Figure(FlownPlot(data.flown, settled_km),
              absl::StrCat("The same initial condition (number ", data.flown_at, ") under each choice of gains."));
}

void AddGainFigures(const CampaignPageData& data, Page& page) {
  page.Heading("Gains over all initial conditions");
  const bool has_results = data.campaign.has_results();
  const v1::CampaignResults& results = data.campaign.results();
  for (std::size_t i = 0; i < 5; ++i) {
    Plot plot{.title = absl::StrCat(GainTitle(i), " over iterations, all initial conditions"),
              .x_label = "iteration",
              .y_label = GainTitle(i),
              .log_y = true};
    plot.height = 220;
    for (const MemberLines& member : data.lines) {
      plot.series.push_back({absl::StrCat("k", i + 1, " many"), "", member.gains[i]});
    }
    if (has_results) plot.levels.push_back({ToArray(results.mean_gains())[i], "mean", "K-hat"});
    if (results.has_robust_gains()) plot.levels.push_back({ToArray(results.robust_gains())[i], "robust", "robust K"});
    page.Figure(plot, absl::StrCat(GainTitle(i), " of ", data.lines.size(), " initial conditions."),
                GainPointsPerLine(data.lines.size()));
  }
}

void AddMembers(const std::vector<v1::CampaignMember>& members, Page& page) {
  std::vector<std::vector<std::string>> rows;
  for (const v1::CampaignMember& member : members) {
    if (rows.size() == kMostMemberRows) break;
    std::vector<std::string> row = {absl::StrCat(RoleText(member.role()), " ", member.number()),
                                    member.job().empty() ? "-" : StateText(member.job_state())};
    for (const v1::GainsChoice choice : {v1::GAINS_CHOICE_INITIAL, v1::GAINS_CHOICE_TUNED, v1::GAINS_CHOICE_BEST,
                                         v1::GAINS_CHOICE_MEAN, v1::GAINS_CHOICE_ROBUST}) {
      const v1::MemberEpisode* const episode = FindEpisode(member, choice);
      row.push_back(episode == nullptr || !episode->has_cost() ? "-" : Human(episode->cost(), 5));
    }
    const v1::MemberEpisode* const tuned = FindEpisode(member, v1::GAINS_CHOICE_TUNED);
    const bool cost = tuned != nullptr && tuned->has_cost();
    row.push_back(cost ? Human(tuned->settling_time_s() / 3600, 5) : "-");
    row.push_back(cost ? Human(tuned->fuel_sum(), 5) : "-");
    row.push_back(cost ? Human(tuned->delta_v_to_settling_m_s(), 5) : "-");
    row.push_back(tuned != nullptr ? GainsText(tuned->gains()) : "");
    rows.push_back(std::move(row));
  }
  page.Heading("Every initial condition");
  if (members.size() > rows.size()) {
    page.Paragraph(absl::StrCat("The first ", rows.size(), " of ", members.size(), "."), "soft");
  }
  page.Table({"", "job", "J under K(1)", "K*", "best K", "K-hat", "robust", "settles in (h)", "fuel sum",
              "delta-v (m/s)", "K*"},
             rows);
}

std::string TitleOf(const std::string& kind, const std::string& display_name, const std::string& scenario,
                    const std::string& name) {
  const std::string what = !display_name.empty() ? display_name : !scenario.empty() ? scenario : name;
  return absl::StrCat(kind, " ", what);
}

int PointsPerLine(std::size_t budget, std::size_t lines) {
  return static_cast<int>(std::clamp<std::size_t>(budget / std::max<std::size_t>(lines, 1), 40, 600));
}

}  // namespace

int DistancePointsPerLine(std::size_t members) { return PointsPerLine(45'000, 2 * members); }

int GainPointsPerLine(std::size_t members) { return PointsPerLine(40'000, 5 * members); }

std::string JobPage(const JobPageData& data) {
  const v1::Job& job = data.job;
  Page page(TitleOf("Tuning", job.display_name(), job.scenario(), job.name()));
  page.Paragraph(absl::StrCat(job.name(), ", ", StateText(job.state()), ", ", UtcTime(job.create_time())), "soft");
  if (!job.error_message().empty()) page.Paragraph(job.error_message(), "warning");
  if (job.has_report()) {
    page.Heading("Before and after");
    AddComparison(job.report(), page);
    for (const v1::Warning& warning : job.report().warnings()) page.Paragraph(warning.message(), "warning");
  }
  if (!data.flown.empty()) {
    page.Figure(FlownPlot(data.flown, job.scenario_definition().settling_distance_km()),
                "Distance to the target over time.");
  }
  if (!data.iterations.empty()) AddSearchFigures(data, page);
  AddJobProvenance(job, page);
  return page.Finish();
}

std::string CampaignPage(const CampaignPageData& data) {
  const v1::Campaign& campaign = data.campaign;
  Page page(TitleOf("Campaign", campaign.display_name(), campaign.scenario(), campaign.name()));
  page.Paragraph(
      absl::StrCat(campaign.name(), ", ", CampaignStateText(campaign.state()), ", ", UtcTime(campaign.create_time())),
      "soft");
  if (!campaign.error_message().empty()) page.Paragraph(campaign.error_message(), "warning");
  if (campaign.has_results()) AddResults(campaign.results(), page);
  if (!data.lines.empty()) {
    page.Heading("Before and after");
    AddTrajectories(data, page);
    AddGainFigures(data, page);
  }
  AddMembers(data.members, page);
  AddCampaignProvenance(campaign, page);
  return page.Finish();
}

}  // namespace orbitune::cli
