#include "server/jobs/campaign_results.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/check.h"
#include "core/sim/scalar_simulator.h"
#include "core/simd/batch_simulator.h"

namespace orbitune {
namespace {

// Episodes between two looks at `cancelled`: some milliseconds.
constexpr std::size_t kEpisodesAtOnce = 64;

constexpr std::size_t kMostFailuresNamed = 10;

std::string_view TitleOf(GainsChoice choice) {
  switch (choice) {
    case GainsChoice::kInitial:
      return "K(1)";
    case GainsChoice::kTuned:
      return "K*, tuned for each";
    case GainsChoice::kBest:
      return "the best K of each";
    case GainsChoice::kMean:
      return "the mean K-hat";
    case GainsChoice::kRobust:
      return "the robust K";
    case GainsChoice::kNearest:
      return "K* of the nearest tuned one";
  }
  return "";
}

const MemberEpisode* Find(const CampaignMember& member, GainsChoice choice) {
  const auto found = std::ranges::find(member.episodes, choice, &MemberEpisode::choice);
  return found == member.episodes.end() ? nullptr : &*found;
}

std::array<double, 6> Coordinates(const ErrorState& x) { return {x.x1, x.x2, x.x3, x.x4, x.x5, x.x6}; }

// The tuned members' x(0) and K*, and which is nearest to another x(0); each coordinate in units of its own standard
// deviation over the tuned members.
class Neighbours {
 public:
  void Add(const ErrorState& x, const Gains& gains) { points_.push_back({Coordinates(x), gains}); }

  void Finish() {
    for (std::size_t i = 0; i < scale_.size(); ++i) {
      double sum = 0;
      double squares = 0;
      for (const Point& p : points_) sum += p.x[i];
      const double mean = sum / static_cast<double>(points_.size());
      for (const Point& p : points_) squares += (p.x[i] - mean) * (p.x[i] - mean);
      scale_[i] = squares > 0 ? std::sqrt(static_cast<double>(points_.size()) / squares) : 0;
    }
  }

  // The earliest of the nearest.
  const Gains& Nearest(const ErrorState& to) const {
    const auto x = Coordinates(to);
    const auto distance = [&](const Point& p) {
      double sum = 0;
      for (std::size_t i = 0; i < x.size(); ++i) sum += std::pow((p.x[i] - x[i]) * scale_[i], 2);
      return sum;
    };
    return std::ranges::min_element(points_, {}, distance)->gains;
  }

 private:
  struct Point {
    std::array<double, 6> x;
    Gains gains;
  };
  std::vector<Point> points_;
  std::array<double, 6> scale_{};
};

// Episodes to be flown, and where each result goes.
class Flights {
 public:
  // Both pointers outlive Fly, which appends to the member's episodes in the order of the calls.
  void Add(GainsChoice choice, const Gains& gains, const PreparedScenario& prepared, CampaignMember& member) {
    flights_.push_back({choice, gains, &prepared, &member});
  }

  absl::Status Fly(const std::function<bool()>& cancelled) {
    for (std::size_t begin = 0; begin < flights_.size(); begin += kEpisodesAtOnce) {
      if (cancelled()) return absl::CancelledError("the comparison of gains is not wanted any more");
      FlySome(std::span(flights_).subspan(begin, std::min(kEpisodesAtOnce, flights_.size() - begin)), cancelled);
    }
    return absl::OkStatus();
  }

 private:
  struct Flight {
    GainsChoice choice;
    Gains gains;
    const PreparedScenario* prepared;
    CampaignMember* member;
  };

  // The cost and its terms by the engine that the searches use, the true delta-v by the one that measures it.
  static void FlySome(std::span<const Flight> flights, const std::function<bool()>& cancelled) {
    std::vector<BatchEpisode> episodes;
    for (const Flight& f : flights) episodes.push_back({.problem = &f.prepared->problem, .gains = f.gains});
    std::vector<EpisodeResult> results(flights.size());
    SimulateBatch(episodes, results);
    for (std::size_t i = 0; i < flights.size(); ++i) {
      const Flight& f = flights[i];
      MemberEpisode episode{.choice = f.choice, .gains = f.gains, .outcome = results[i].outcome};
      if (HasCost(episode.outcome)) {
        episode.cost = results[i].cost;
        episode.settling_samples = results[i].settling_samples;
        episode.fuel_sum = results[i].fuel_sum;
        const EpisodeResult measured =
            SimulateEpisode(f.prepared->problem, f.gains, {.measure_effort = true, .cancelled = cancelled});
        episode.delta_v_to_settling_m_s = measured.delta_v_to_settling * f.prepared->units.velocity_m_s();
      }
      f.member->episodes.push_back(episode);
    }
  }

  std::vector<Flight> flights_;
};

// A reduction is defined where there is something to reduce.
void AddReduction(std::vector<double>& reductions, double before, double after) {
  if (before > 0 && !std::isnan(after)) reductions.push_back(100 * (1 - after / before));
}

GainsComparison Compare(GainsChoice choice, MemberRole over, std::span<const CampaignMember> members) {
  GainsComparison comparison{.choice = choice, .over = over};
  std::vector<double> cost, settling, fuel, delta_v;
  for (const CampaignMember& member : members) {
    const MemberEpisode* const after = member.id.role == over ? Find(member, choice) : nullptr;
    if (after == nullptr) continue;
    ++comparison.flown;
    comparison.settled += after->outcome == Outcome::kSettled;
    comparison.not_settled += after->outcome == Outcome::kNotSettled;
    comparison.without_cost += !HasCost(after->outcome);
    const MemberEpisode* const before = Find(member, GainsChoice::kInitial);
    if (!HasCost(after->outcome) || before == nullptr || !HasCost(before->outcome)) continue;
    ++comparison.compared;
    AddReduction(cost, before->cost, after->cost);
    AddReduction(settling, before->settling_samples, after->settling_samples);
    AddReduction(fuel, before->fuel_sum, after->fuel_sum);
    AddReduction(delta_v, before->delta_v_to_settling_m_s, after->delta_v_to_settling_m_s);
  }
  comparison.cost_percent = StatisticsOf(std::move(cost));
  comparison.settling_time_percent = StatisticsOf(std::move(settling));
  comparison.fuel_sum_percent = StatisticsOf(std::move(fuel));
  comparison.delta_v_percent = StatisticsOf(std::move(delta_v));
  return comparison;
}

// Gains that fail to settle less often come first, then those that save more.
bool DoesBetter(const GainsComparison& a, const GainsComparison& b) {
  if (a.settled != b.settled) return a.settled > b.settled;
  return a.cost_percent.average > b.cost_percent.average;
}

// Gains that can be used on an initial condition without tuning for it.
bool NeedsNoTuning(GainsChoice choice) { return choice != GainsChoice::kTuned && choice != GainsChoice::kBest; }

std::string Settles(const GainsComparison& c) {
  if (c.settled == c.flown) return "and all settle";
  return absl::StrCat("and the chaser does not settle on ", c.flown - c.settled, " of ", c.flown);
}

std::string Describe(const GainsComparison& c) {
  if (c.compared == 0) return absl::StrFormat("under %s nothing can be compared, %s", TitleOf(c.choice), Settles(c));
  return absl::StrFormat("under %s the cost is %.1f %% less than under K(1) on average, %.1f %% less at worst, %s",
                         TitleOf(c.choice), c.cost_percent.average, c.cost_percent.minimum, Settles(c));
}

std::string DescribeComparisons(const CampaignResults& results, int held_out) {
  const MemberRole over = held_out > 0 ? MemberRole::kHeldOut : MemberRole::kTuned;
  std::string text =
      held_out > 0
          ? absl::StrFormat("On the %d held-out initial conditions %s does best", held_out,
                            TitleOf(*results.best_on_held_out))
          : "No initial conditions were held out, so how these gains do on new ones is not known. On the tuned ones";
  std::string separator = ": ";
  for (const GainsComparison& c : results.comparisons) {
    if (c.over != over || c.choice == GainsChoice::kInitial || c.choice == GainsChoice::kBest) continue;
    absl::StrAppend(&text, separator, Describe(c));
    separator = "; ";
  }
  return absl::StrCat(text, ".");
}

std::string NameOf(const EndedMember& member) {
  const int number = member.member.id.number;
  switch (member.member.id.role) {
    case MemberRole::kTuned:
      return absl::StrCat("initial condition ", number);
    case MemberRole::kHeldOut:
      return absl::StrCat("held-out initial condition ", number);
    case MemberRole::kRobust:
      break;
  }
  return "the robust tuning";
}

std::string DescribeFailures(std::span<const EndedMember> members) {
  std::string text;
  std::size_t count = 0;
  for (const EndedMember& m : members) {
    if (m.member.job_id.empty() || m.report) continue;
    if (++count > kMostFailuresNamed) continue;
    const std::string why = m.state == JobState::kCancelled ? "was cancelled" : m.error_message;
    absl::StrAppend(&text, text.empty() ? "" : "; ", NameOf(m), " (jobs/", m.member.job_id, "): ", why);
  }
  if (count == 0) return "";
  if (count > kMostFailuresNamed) absl::StrAppend(&text, "; and ", count - kMostFailuresNamed, " more");
  return absl::StrCat(count, count == 1 ? " job" : " jobs", " did not succeed, and ", count == 1 ? "is" : "are",
                      " in no average: ", text, ".");
}

// The gains of the newest robust job, if that succeeded.
std::optional<Gains> RobustGains(std::span<const EndedMember> members) {
  std::optional<Gains> gains;
  for (const EndedMember& m : members) {
    if (m.member.id.role != MemberRole::kRobust) continue;
    gains = m.report ? std::optional(m.report->best.gains) : std::nullopt;
  }
  return gains;
}

}  // namespace

ReductionStatistics StatisticsOf(std::vector<double> values) {
  ReductionStatistics spread;
  if (values.empty()) return spread;
  double sum = 0;
  for (const double value : values) sum += value;
  spread.average = sum / static_cast<double>(values.size());
  std::ranges::sort(values);
  spread.minimum = values.front();
  spread.maximum = values.back();
  for (std::size_t i = 0; i < kPercentiles.size(); ++i) {
    const double rank = static_cast<double>(values.size() - 1) * kPercentiles[i] / 100;
    const auto below = static_cast<std::size_t>(rank);
    const std::size_t above = std::min(below + 1, values.size() - 1);
    spread.percentiles[i] = values[below] + (rank - static_cast<double>(below)) * (values[above] - values[below]);
  }
  return spread;
}

Gains MeanGains(std::span<const Gains> gains) {
  ORBITUNE_CHECK(!gains.empty());
  Gains mean{};
  for (const Gains& k : gains) {
    for (std::size_t i = 0; i < kGainCount; ++i) mean[i] += k[i];
  }
  for (double& k : mean) k /= static_cast<double>(gains.size());
  return mean;
}

MemberEpisode ToMemberEpisode(GainsChoice choice, const GainsAssessment& assessed) {
  const EpisodeReport& e = assessed.episode;
  MemberEpisode episode{.choice = choice, .gains = assessed.gains, .outcome = e.outcome};
  if (!HasCost(e.outcome)) return episode;
  episode.cost = e.cost;
  episode.settling_samples = e.settling_samples;
  episode.fuel_sum = e.fuel_sum;
  episode.delta_v_to_settling_m_s = e.delta_v_to_settling_m_s;
  return episode;
}

const GainsAssessment& TunedGains(const JobReport& report, Algorithm algorithm) {
  return algorithm == Algorithm::kArs ? report.final : report.best;
}

absl::StatusOr<CampaignOutcome> CompareGains(const CampaignSpec& spec, std::span<const EndedMember> members,
                                             const std::function<bool()>& cancelled) {
  const Algorithm algorithm = spec.scenario.search.algorithm;
  CampaignOutcome outcome;
  CampaignResults& results = outcome.results;
  std::vector<PreparedScenario> prepared;
  std::vector<const JobReport*> reports;
  std::vector<Gains> tuned;
  Neighbours neighbours;
  for (const EndedMember& m : members) {
    if (m.report) results.episodes += m.report->episodes;
    if (m.member.id.role == MemberRole::kRobust) continue;
    auto p = Prepare(spec.scenario, m.member.initial_condition);
    if (!p.ok()) return p.status();
    if (m.report && m.member.id.role == MemberRole::kTuned) {
      tuned.push_back(TunedGains(*m.report, algorithm).gains);
      neighbours.Add(p->problem.initial_error, tuned.back());
    }
    prepared.push_back(*std::move(p));
    reports.push_back(m.report ? &*m.report : nullptr);
    outcome.members.push_back(m.member);
    outcome.members.back().episodes.clear();
  }
  const std::string failures = DescribeFailures(members);
  if (tuned.empty()) {
    return absl::FailedPreconditionError(absl::StrCat("no initial condition could be tuned. ", failures));
  }
  neighbours.Finish();
  results.mean_of = static_cast<int>(tuned.size());
  results.mean_gains = MeanGains(tuned);
  results.robust_gains = RobustGains(members);

  Flights flights;
  int held_out = 0;
  for (std::size_t i = 0; i < outcome.members.size(); ++i) {
    CampaignMember& member = outcome.members[i];
    if (const JobReport* const report = reports[i]; report != nullptr) {
      member.episodes.push_back(ToMemberEpisode(GainsChoice::kInitial, report->initial));
      member.episodes.push_back(ToMemberEpisode(GainsChoice::kTuned, TunedGains(*report, algorithm)));
      member.episodes.push_back(ToMemberEpisode(GainsChoice::kBest, report->best));
    } else {
      flights.Add(GainsChoice::kInitial, spec.scenario.search.initial_gains, prepared[i], member);
    }
    flights.Add(GainsChoice::kMean, results.mean_gains, prepared[i], member);
    if (results.robust_gains) flights.Add(GainsChoice::kRobust, *results.robust_gains, prepared[i], member);
    if (member.id.role != MemberRole::kHeldOut) continue;
    ++held_out;
    flights.Add(GainsChoice::kNearest, neighbours.Nearest(prepared[i].problem.initial_error), prepared[i], member);
  }
  if (absl::Status status = flights.Fly(cancelled); !status.ok()) return status;

  for (const MemberRole over : {MemberRole::kTuned, MemberRole::kHeldOut}) {
    const GainsComparison* best = nullptr;
    results.comparisons.reserve(2 * kGainsChoices);  // `best` stays valid
    for (std::size_t i = 0; i < kGainsChoices; ++i) {
      const GainsComparison c = Compare(static_cast<GainsChoice>(i), over, outcome.members);
      if (c.flown == 0) continue;
      results.comparisons.push_back(c);
      if (NeedsNoTuning(c.choice) && (best == nullptr || DoesBetter(c, *best))) best = &results.comparisons.back();
    }
    if (over == MemberRole::kHeldOut && best != nullptr) results.best_on_held_out = best->choice;
  }
  results.conclusion = DescribeComparisons(results, held_out);
  if (!failures.empty()) absl::StrAppend(&results.conclusion, " ", failures);
  return outcome;
}

}  // namespace orbitune
