#include "tests/bench/gains_evaluation.h"

#include <algorithm>
#include <string>
#include <thread>
#include <vector>

#include "core/base/check.h"
#include "core/library/query.h"
#include "core/scenario/presets.h"
#include "core/search/ensemble_search.h"
#include "core/simd/batch_simulator.h"

namespace orbitune::bench {
namespace {

const Scenario& Leo() { return *FindPreset("leo-rendezvous"); }

void FlyBatch(const EpisodeProblem& problem, std::span<const Gains> gains, std::span<EpisodeResult> results) {
  std::vector<BatchEpisode> episodes;
  for (const Gains& k : gains) episodes.push_back({.problem = &problem, .gains = k});
  SimulateBatch(episodes, results);
}

orbitune::Evaluate FlyIn(const EpisodeProblem& problem) {
  return
      [&problem](std::span<const Gains> gains, std::span<EpisodeResult> results) { FlyBatch(problem, gains, results); };
}

SearchOptions CmaEsFor(std::int64_t episodes, std::uint64_t seed) {
  SearchOptions options = Leo().search;
  options.algorithm = Algorithm::kCmaEs;
  options.iterations = SearchOptions::kMaxIterations;
  options.max_episodes = episodes;
  options.seed = seed;
  return options;
}

struct Tuned {
  PreparedScenario prepared;
  IterationRecord best;
};

Tuned TuneOne(const OrbitState& start, const EvaluationOptions& options, std::uint64_t seed) {
  auto prepared = Prepare(Leo(), start);
  ORBITUNE_CHECK(prepared.ok());
  Tuned tuned{.prepared = *std::move(prepared)};
  const absl::Status status =
      RunSearch(CmaEsFor(options.episodes, seed), FlyIn(tuned.prepared.problem), [&](const IterationRecord& record) {
        if (record.iteration == 1 || Better(record, tuned.best)) tuned.best = record;
      });
  ORBITUNE_CHECK(status.ok());
  return tuned;
}

void ForEach(std::size_t count, const std::function<void(std::size_t)>& task) {
  std::vector<std::thread> threads;
  const std::size_t workers = std::max(1u, std::thread::hardware_concurrency());
  for (std::size_t t = 0; t < workers; ++t) {
    threads.emplace_back([&, t] {
      for (std::size_t i = t; i < count; i += workers) task(i);
    });
  }
  for (std::thread& thread : threads) thread.join();
}

std::vector<Tuned> TuneAll(DrawSet set, int count, const EvaluationOptions& options) {
  const auto starts = DrawMany(Leo().neighbourhood, options.seed, set, 0, static_cast<std::uint32_t>(count));
  ORBITUNE_CHECK(starts.ok());
  std::vector<Tuned> tuned(starts->size());
  ForEach(tuned.size(), [&](std::size_t i) { tuned[i] = TuneOne((*starts)[i], options, i + 1); });
  return tuned;
}

Gains ArithmeticMean(const std::vector<Tuned>& tuned) {
  Gains mean{};
  for (const Tuned& one : tuned) {
    for (std::size_t i = 0; i < kGainCount; ++i) mean[i] += one.best.gains[i] / static_cast<double>(tuned.size());
  }
  return mean;
}

Gains RobustGains(const std::vector<Tuned>& tuned, const EvaluationOptions& options) {
  EnsembleSearch search(CmaEsFor(options.episodes * static_cast<std::int64_t>(tuned.size()), options.seed),
                        {.aggregate = Aggregate::kMean, .relative_to_initial = true}, tuned.size());
  IterationRecord best;
  std::vector<EpisodeResult> results;
  while (!search.done()) {
    results.assign(search.episodes(), {});
    ForEach(2, [&](std::size_t half) {
      const std::size_t begin = half * results.size() / 2;
      const std::size_t end = (half + 1) * results.size() / 2;
      std::vector<BatchEpisode> episodes;
      for (std::size_t e = begin; e < end; ++e) {
        episodes.push_back({.problem = &tuned[search.initial_condition(e)].prepared.problem, .gains = search.gains(e)});
      }
      SimulateBatch(episodes, std::span(results).subspan(begin, end - begin));
    });
    const auto record = search.Update(results);
    ORBITUNE_CHECK(record.ok());
    if (record->iteration == 1 || Better(*record, best)) best = *record;
  }
  return best.gains;
}

double CostOf(const PreparedScenario& prepared, const Gains& gains) {
  EpisodeResult result;
  FlyBatch(prepared.problem, {&gains, 1}, {&result, 1});
  return result.cost;
}

}  // namespace

std::vector<Gains> TunedGains(int count, const EvaluationOptions& options) {
  std::vector<Gains> gains;
  for (const Tuned& one : TuneAll(DrawSet::kTuning, count, options)) gains.push_back(one.best.gains);
  return gains;
}

EvaluationRow Evaluate(const EvaluationOptions& options) {
  const std::vector<Tuned> tuned = TuneAll(DrawSet::kTuning, options.tuned, options);
  const std::vector<Tuned> held_out = TuneAll(DrawSet::kHeldOut, options.held_out, options);
  const Gains mean = ArithmeticMean(tuned);
  const Gains robust = RobustGains(tuned, options);
  ScenarioLibrary library(tuned.front().prepared.problem.settling_distance);
  std::vector<LibraryEntry> entries = {{.id = "mean", .kind = GainSetKind::kMean, .gains = mean},
                                       {.id = "robust", .kind = GainSetKind::kRobust, .gains = robust}};
  for (std::size_t i = 0; i < tuned.size(); ++i) {
    entries.push_back({.id = std::to_string(i),
                       .gains = tuned[i].best.gains,
                       .initial_error = tuned[i].prepared.problem.initial_error});
  }
  library.Add(entries);

  EvaluationRow row;
  const double n = static_cast<double>(held_out.size());
  for (const Tuned& one : held_out) {
    QueryResult query = QueryLibrary(&library, one.prepared, Leo().search.initial_gains, {}, FlyBatch);
    const double full = one.best.cost;
    const double answer = query.answers.front().flight.cost;
    const double of_mean = CostOf(one.prepared, mean);
    const double of_robust = CostOf(one.prepared, robust);
    RefineAnswers(one.prepared, {.budget = std::chrono::milliseconds(options.refine_ms)}, FlyBatch, 5, query);
    const double refined = query.answers.front().flight.cost;
    row.query_mean += answer / full / n;
    row.query_worst = std::max(row.query_worst, answer / full);
    row.refined_mean += refined / full / n;
    row.refined_worst = std::max(row.refined_worst, refined / full);
    row.mean_gains_mean += of_mean / full / n;
    row.robust_mean += of_robust / full / n;
    row.worse_than_mean_gains += answer > of_mean ? 1 : 0;
    row.worse_than_robust += answer > of_robust ? 1 : 0;
    row.extrapolated += query.position.extrapolated ? 1 : 0;
    row.refine_episodes += static_cast<double>(query.refined->episodes) / n;
  }
  return row;
}

}  // namespace orbitune::bench
