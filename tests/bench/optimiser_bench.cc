#include "tests/bench/optimiser_bench.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include "core/base/check.h"
#include "core/scenario/presets.h"
#include "core/search/optimiser.h"
#include "core/simd/batch_simulator.h"

namespace orbitune::bench {
namespace {

struct Contender {
  std::string name;
  void (*choose)(SearchOptions&);
};

const std::vector<Contender>& Contenders() {
  static const auto* const contenders = new std::vector<Contender>{
      {"ARS, the paper's", [](SearchOptions&) {}},
      {"ARS in ln K, top 8 of 16",
       [](SearchOptions& o) {
         o.ars_variants = {.top_directions = 8, .log_gains = true};
         o.step_size = 0.1;
         o.exploration_scale = 0.05;
         o.exploration_std = o.initial_gains;  // alike for every ln K
       }},
      {"Nelder-Mead", [](SearchOptions& o) { o.algorithm = Algorithm::kNelderMead; }},
      {"CMA-ES", [](SearchOptions& o) { o.algorithm = Algorithm::kCmaEs; }},
  };
  return *contenders;
}

// The best cost so far at each of the budgets.
struct Curve {
  double initial = 0;
  std::vector<double> best;
  double seconds = 0;
};

Curve Tune(const EpisodeProblem& problem, SearchOptions options, const std::vector<std::int64_t>& budgets) {
  options.max_episodes = budgets.back();
  options.iterations = SearchOptions::kMaxIterations;
  const auto begin = std::chrono::steady_clock::now();
  const auto evaluate = [&](std::span<const Gains> gains, std::span<EpisodeResult> results) {
    std::vector<BatchEpisode> episodes;
    for (const Gains& k : gains) episodes.push_back({.problem = &problem, .gains = k});
    SimulateBatch(episodes, results);
  };
  Curve curve{.best = std::vector<double>(budgets.size(), std::numeric_limits<double>::quiet_NaN())};
  double best = std::numeric_limits<double>::infinity();
  const absl::Status status = RunSearch(options, evaluate, [&](const IterationRecord& record) {
    if (record.iteration == 1) curve.initial = record.cost;
    if (record.outcome == Outcome::kSettled) best = std::min(best, record.cost);
    for (std::size_t b = 0; b < budgets.size(); ++b) {
      if (record.episodes <= budgets[b]) curve.best[b] = best;
    }
  });
  ORBITUNE_CHECK(status.ok());
  // A search that ended before a budget was spent has its last best there.
  for (std::size_t b = 1; b < budgets.size(); ++b) curve.best[b] = std::fmin(curve.best[b], curve.best[b - 1]);
  curve.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return curve;
}

std::vector<EpisodeProblem> DrawProblems(const Scenario& scenario, const OptimiserBenchOptions& options) {
  const auto states = DrawMany(scenario.neighbourhood, options.seed, DrawSet::kTuning, 0,
                               static_cast<std::uint32_t>(options.initial_conditions));
  ORBITUNE_CHECK(states.ok());
  std::vector<EpisodeProblem> problems;
  for (const OrbitState& state : *states) problems.push_back(Prepare(scenario, state)->problem);
  return problems;
}

std::vector<Curve> TuneAll(const std::vector<EpisodeProblem>& problems, const SearchOptions& options,
                           const std::vector<std::int64_t>& budgets, int threads) {
  std::vector<Curve> curves(problems.size());
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    for (std::size_t i = next++; i < problems.size(); i = next++) curves[i] = Tune(problems[i], options, budgets);
  };
  std::vector<std::jthread> workers;
  for (int t = 1; t < threads; ++t) workers.emplace_back(work);
  work();
  workers.clear();
  return curves;
}

OptimiserRow RowAt(std::size_t b, const std::vector<Curve>& curves) {
  OptimiserRow row{.min_percent = 100, .max_percent = -100};
  for (const Curve& curve : curves) {
    const double percent = 100 * (1 - curve.best[b] / curve.initial);
    const auto n = static_cast<double>(curves.size());
    row.mean_percent += percent / n;
    row.mean_cost += curve.best[b] / n;
    row.seconds += curve.seconds / n;
    row.min_percent = std::min(row.min_percent, percent);
    row.max_percent = std::max(row.max_percent, percent);
  }
  return row;
}

}  // namespace

std::vector<OptimiserRow> CompareOptimisers(const OptimiserBenchOptions& options) {
  std::vector<std::int64_t> budgets;
  for (const std::int64_t divisor : {20, 10, 5, 2, 1}) budgets.push_back(options.budget / divisor);
  std::vector<OptimiserRow> rows;
  for (const char* id : {"gto-geo", "leo-rendezvous"}) {
    const Scenario& scenario = *FindPreset(id);
    const auto problems = DrawProblems(scenario, options);
    for (const Contender& contender : Contenders()) {
      SearchOptions search = scenario.search;
      search.seed = options.seed;
      contender.choose(search);
      const auto curves = TuneAll(problems, search, budgets, options.threads);
      for (std::size_t b = 0; b < budgets.size(); ++b) {
        OptimiserRow row = RowAt(b, curves);
        row.scenario = id;
        row.optimiser = contender.name;
        row.episodes = budgets[b];
        rows.push_back(row);
      }
    }
  }
  return rows;
}

}  // namespace orbitune::bench
