#include "server/jobs/campaign_results.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
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
    return cancelled() ? absl::CancelledError("the comparison of gains is not wanted any more") : absl::OkStatus();
  }

 private:
  struct Flight {
    GainsChoice choice;
    Gains gains;
    const PreparedScenario* prepared;
    CampaignMember* member;
  };

  // By the scalar simulator, which measures the true delta-v, too; where it takes too many steps, by the search's.
  static void FlySome(std::span<const Flight> flights, const std::function<bool()>& cancelled) {
    for (const Flight& f : flights) {
      EpisodeResult result =
          SimulateEpisode(f.prepared->problem, f.gains, {.measure_effort = true, .cancelled = cancelled});
      const double delta_v = result.delta_v_to_settling * f.prepared->units.velocity_m_s();
      const BatchEpisode again{.problem = &f.prepared->problem, .gains = f.gains};
      if (result.outcome == Outcome::kNumericalFailure) SimulateBatch({&again, 1}, {&result, 1}, cancelled);
      MemberEpisode episode{.choice = f.choice, .gains = f.gains, .outcome = result.outcome};
      if (HasCost(episode.outcome)) {
        episode.cost = result.cost;
        episode.settling_samples = result.settling_samples;
        episode.fuel_sum = result.fuel_sum;
        episode.delta_v_to_settling_m_s = delta_v;
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
  if (c.compared == 0)
    return absl::StrFormat("under %s there is nothing to compare, %s", TitleOf(c.choice), Settles(c));
  return absl::StrFormat("under %s the cost falls by %.1f %% on average and %.1f %% at worst, %s", TitleOf(c.choice),
                         c.cost_percent.average, c.cost_percent.minimum, Settles(c));
}

std::string DescribeComparisons(const CampaignResults& results) {
  const bool held_out = results.best_on_held_out.has_value();
  const MemberRole over = held_out ? MemberRole::kHeldOut : MemberRole::kTuned;
  std::vector<std::string> described;
  int flown = 0;
  for (const GainsComparison& c : results.comparisons) {
    if (c.over != over) continue;
    flown = std::max(flown, c.flown);
    if (c.choice != GainsChoice::kInitial && c.choice != GainsChoice::kBest) described.push_back(Describe(c));
  }
  const std::string beginning =
      held_out
          ? absl::StrFormat("On the %d held-out initial conditions %s does best", flown,
                            TitleOf(*results.best_on_held_out))
          : "No initial conditions were held out, so how these gains do on new ones is not known. On the tuned ones";
  return absl::StrCat(beginning, ": ", absl::StrJoin(described, "; "), ".");
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

// An initial condition that gains are flown on.
struct Entrant {
  CampaignMember member;
  PreparedScenario prepared;
  const JobReport* report;  // nullptr: it has none
};

struct Field {
  std::vector<Entrant> entrants;
  std::vector<Gains> tuned;  // K* of the tuned ones
  Neighbours neighbours;

  // members: outlive this.
  absl::Status Enter(const CampaignSpec& spec, std::span<const EndedMember> members) {
    for (const EndedMember& m : members) {
      if (m.member.id.role == MemberRole::kRobust) continue;
      auto prepared = Prepare(spec.scenario, m.member.initial_condition);
      if (!prepared.ok()) return prepared.status();
      if (m.report && m.member.id.role == MemberRole::kTuned) {
        tuned.push_back(TunedGains(*m.report, spec.scenario.search.algorithm).gains);
        neighbours.Add(prepared->problem.initial_error, tuned.back());
      }
      entrants.push_back({m.member, *std::move(prepared), m.report ? &*m.report : nullptr});
      entrants.back().member.episodes.clear();
    }
    neighbours.Finish();
    return absl::OkStatus();
  }

  // Every member's episodes, in the order of GainsChoice: its own job's as they are, the others flown.
  absl::Status Fly(const CampaignSpec& spec, const CampaignResults& results, const std::function<bool()>& cancelled) {
    Flights flights;
    for (Entrant& e : entrants) {
      if (e.report != nullptr) {
        e.member.episodes = EpisodesOf(*e.report, spec.scenario.search.algorithm);
      } else {
        flights.Add(GainsChoice::kInitial, spec.scenario.search.initial_gains, e.prepared, e.member);
      }
      flights.Add(GainsChoice::kMean, results.mean_gains, e.prepared, e.member);
      if (results.robust_gains) flights.Add(GainsChoice::kRobust, *results.robust_gains, e.prepared, e.member);
      if (e.member.id.role != MemberRole::kHeldOut) continue;
      flights.Add(GainsChoice::kNearest, neighbours.Nearest(e.prepared.problem.initial_error), e.prepared, e.member);
    }
    return flights.Fly(cancelled);
  }
};

void AddComparisons(std::span<const CampaignMember> members, CampaignResults& results) {
  for (const MemberRole over : {MemberRole::kTuned, MemberRole::kHeldOut}) {
    std::optional<GainsComparison> best;
    for (std::size_t i = 0; i < kGainsChoices; ++i) {
      const GainsComparison c = Compare(static_cast<GainsChoice>(i), over, members);
      if (c.flown == 0) continue;
      results.comparisons.push_back(c);
      if (NeedsNoTuning(c.choice) && (!best || DoesBetter(c, *best))) best = c;
    }
    if (over == MemberRole::kHeldOut && best) results.best_on_held_out = best->choice;
  }
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

std::vector<MemberEpisode> EpisodesOf(const JobReport& report, Algorithm algorithm) {
  return {ToMemberEpisode(GainsChoice::kInitial, report.initial),
          ToMemberEpisode(GainsChoice::kTuned, TunedGains(report, algorithm)),
          ToMemberEpisode(GainsChoice::kBest, report.best)};
}

const GainsAssessment& TunedGains(const JobReport& report, Algorithm algorithm) {
  return algorithm == Algorithm::kArs ? report.final : report.best;
}

absl::StatusOr<CampaignOutcome> CompareGains(const CampaignSpec& spec, std::span<const EndedMember> members,
                                             const std::function<bool()>& cancelled) {
  Field field;
  if (absl::Status status = field.Enter(spec, members); !status.ok()) return status;
  const std::string failures = DescribeFailures(members);
  if (field.tuned.empty()) {
    return absl::FailedPreconditionError(absl::StrCat("no initial condition could be tuned. ", failures));
  }
  CampaignOutcome outcome;
  CampaignResults& results = outcome.results;
  results.mean_of = static_cast<int>(field.tuned.size());
  results.mean_gains = MeanGains(field.tuned);
  results.robust_gains = RobustGains(members);
  for (const EndedMember& m : members) results.episodes += m.report ? m.report->episodes : 0;
  if (absl::Status status = field.Fly(spec, results, cancelled); !status.ok()) return status;
  for (const Entrant& entrant : field.entrants) outcome.members.push_back(entrant.member);
  AddComparisons(outcome.members, results);
  results.conclusion = DescribeComparisons(results);
  if (!failures.empty()) absl::StrAppend(&results.conclusion, " ", failures);
  return outcome;
}

}  // namespace orbitune
