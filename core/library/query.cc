#include "core/library/query.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>

#include "core/base/check.h"

namespace orbitune {
namespace {

// Of the candidates, the share that gains for several initial conditions may take, the newest of them.
constexpr int kGeneralShare = 4;

// Candidates are told apart at a loose tolerance, in about half the time: costs then are right to some 1e-4. As many
// more than are answered are flown again at the scenario's own.
constexpr double kScreeningTolerance = 1e-5;
constexpr std::size_t kScreeningMargin = 3;
constexpr double kMeasuringTolerance = 1e-5;

// Threads of a refinement, each from another of the best answers.
constexpr std::size_t kSearches = 2;

// The nearest gain sets that each weighted mean is made of.
constexpr std::size_t kMeansOf[] = {4, 12};

class CandidateList {
 public:
  explicit CandidateList(std::size_t most) : most_(most) {}

  void Add(Candidate candidate) {
    const auto same = [&](const Candidate& other) { return other.gains == candidate.gains; };
    if (list_.size() < most_ && std::ranges::none_of(list_, same)) list_.push_back(std::move(candidate));
  }
  std::size_t room() const { return most_ - list_.size(); }
  std::vector<Candidate> Take() && { return std::move(list_); }

 private:
  const std::size_t most_;
  std::vector<Candidate> list_;
};

// Geometric, weighted by 1 / (d^2 + d_1^2), d_1 the nearest one's distance: beside a stored start, that one's gains
// weigh no more than the others' do elsewhere, for they are a candidate of their own.
Gains WeightedMean(std::span<const ScenarioLibrary::Neighbour> nearest) {
  const double softening = nearest.front().distance * nearest.front().distance + 1e-12;
  Gains mean{};
  double weights = 0;
  for (const auto& [entry, distance] : nearest) {
    const double weight = 1 / (distance * distance + softening);
    weights += weight;
    for (std::size_t i = 0; i < kGainCount; ++i) mean[i] += weight * std::log(entry.gains[i]);
  }
  for (double& gain : mean) gain = std::exp(gain / weights);
  return mean;
}

Candidate Stored(const LibraryEntry& entry, double distance) {
  return {.source = Candidate::Source::kStored,
          .gains = entry.gains,
          .gain_set_id = entry.id,
          .kind = entry.kind,
          .distance = distance};
}

EpisodeProblem WithTolerance(EpisodeProblem problem, double tolerance) {
  problem.tolerance = std::max(problem.tolerance, tolerance);
  return problem;
}

std::vector<EpisodeResult> FlyAll(const EpisodeProblem& problem, std::span<const Candidate> candidates,
                                  const Fly& fly) {
  std::vector<Gains> gains;
  for (const Candidate& candidate : candidates) gains.push_back(candidate.gains);
  std::vector<EpisodeResult> results(gains.size());
  fly(problem, gains, results);
  return results;
}

// The `most` best, the best first; of equals, those that came first.
void KeepBest(std::size_t most, std::vector<Candidate>& candidates, std::vector<EpisodeResult>& results) {
  std::vector<std::size_t> order(candidates.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) { return BetterResult(results[a], results[b]); });
  order.resize(std::min(order.size(), most));
  std::vector<Candidate> best_candidates;
  std::vector<EpisodeResult> best_results;
  for (const std::size_t i : order) {
    best_candidates.push_back(std::move(candidates[i]));
    best_results.push_back(results[i]);
  }
  candidates = std::move(best_candidates);
  results = std::move(best_results);
}

// What is compared of a flight.
EpisodeResult ResultOf(const Flight& flight) { return {.outcome = flight.outcome, .cost = flight.cost}; }

}  // namespace

std::vector<Candidate> ChooseCandidates(const ScenarioLibrary* library, const ErrorState& x, const Gains& initial_gains,
                                        const QueryOptions& options, LibraryPosition& position) {
  const auto most = static_cast<std::size_t>(options.max_candidates);
  CandidateList list(most);
  position = {};
  if (library == nullptr) {
    list.Add({.source = Candidate::Source::kInitial, .gains = initial_gains});
    return std::move(list).Take();
  }
  const auto around = library->Around(x, most, (most + kGeneralShare - 1) / kGeneralShare);
  position = around.position;
  // Were there room for one candidate only, it is the nearest.
  if (!around.nearest.empty()) list.Add(Stored(around.nearest.front().entry, around.nearest.front().distance));
  for (const LibraryEntry& entry : around.general) list.Add(Stored(entry, kUnset));
  for (const std::size_t count : kMeansOf) {
    const std::span nearest = std::span(around.nearest).first(std::min(count, around.nearest.size()));
    if (nearest.size() > 1) list.Add({.source = Candidate::Source::kWeightedMean, .gains = WeightedMean(nearest)});
  }
  if (around.position.located > 1) list.Add({.source = Candidate::Source::kLibraryMean, .gains = *around.mean});
  list.Add({.source = Candidate::Source::kInitial, .gains = initial_gains});
  for (const auto& [entry, distance] : around.nearest) list.Add(Stored(entry, distance));
  return std::move(list).Take();
}

QueryAnswer Measure(const PreparedScenario& prepared, const Candidate& candidate, const EpisodeResult& result) {
  WatchedEpisode episode =
      FlyWatched(WithTolerance(prepared.problem, kMeasuringTolerance), candidate.gains, {.early_exit = true});
  // The two simulators agree to the integration's tolerance only; what was ranked is what is answered.
  if (HasCost(result.outcome)) {
    episode.result.outcome = result.outcome;
    episode.result.cost = result.cost;
    episode.result.settling_samples = result.settling_samples;
    episode.result.fuel_sum = result.fuel_sum;
  }
  return {candidate, ToFlight(episode, prepared, candidate.gains)};
}

QueryResult QueryLibrary(const ScenarioLibrary* library, const PreparedScenario& prepared, const Gains& initial_gains,
                         const QueryOptions& options, const Fly& fly) {
  ORBITUNE_CHECK(options.max_candidates > 0 && options.max_answers > 0);
  QueryResult query;
  std::vector<Candidate> candidates =
      ChooseCandidates(library, prepared.problem.initial_error, initial_gains, options, query.position);
  std::vector<EpisodeResult> results = FlyAll(WithTolerance(prepared.problem, kScreeningTolerance), candidates, fly);
  query.candidates = static_cast<int>(candidates.size());
  query.candidates_settled = static_cast<int>(std::ranges::count(results, Outcome::kSettled, &EpisodeResult::outcome));

  const auto answers = static_cast<std::size_t>(options.max_answers);
  KeepBest(answers + kScreeningMargin, candidates, results);
  results = FlyAll(prepared.problem, candidates, fly);
  KeepBest(answers, candidates, results);
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    query.answers.push_back(Measure(prepared, candidates[i], results[i]));
  }
  return query;
}

void RefineAnswers(const PreparedScenario& prepared, const RefineOptions& options, const Fly& fly,
                   std::size_t max_answers, QueryResult& query) {
  const auto begin = std::chrono::steady_clock::now();
  std::vector<Gains> starts;
  for (const QueryAnswer& answer : std::span(query.answers).first(std::min(kSearches, query.answers.size()))) {
    starts.push_back(answer.candidate.gains);
  }
  const EpisodeProblem screening = WithTolerance(prepared.problem, kScreeningTolerance);
  const RefineResult found = Refine(
      starts, [&](std::span<const Gains> gains, std::span<EpisodeResult> results) { fly(screening, gains, results); },
      options);
  EpisodeResult result;
  fly(prepared.problem, {&found.gains, 1}, {&result, 1});
  Refined& refined = query.refined.emplace();
  refined.episodes = found.episodes;
  refined.improved = BetterResult(result, ResultOf(query.answers.front().flight));
  if (refined.improved) {
    const Candidate candidate{.source = Candidate::Source::kRefined, .gains = found.gains};
    query.answers.insert(query.answers.begin(), Measure(prepared, candidate, result));
    if (query.answers.size() > max_answers) query.answers.pop_back();
  }
  refined.elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

}  // namespace orbitune
