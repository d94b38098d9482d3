#include "core/library/refine.h"

#include <thread>
#include <vector>

#include "core/base/check.h"
#include "core/search/optimiser.h"

namespace orbitune {
namespace {

using Clock = std::chrono::steady_clock;

// The best start is near an optimum already; another one is there to find a different one.
constexpr double kSigmaOfBest = 0.15;
constexpr double kSigmaOfOthers = 0.3;

SearchOptions OptionsFor(const Gains& start, std::size_t index, const RefineOptions& options) {
  SearchOptions search;
  search.algorithm = Algorithm::kCmaEs;
  search.iterations = SearchOptions::kMaxIterations;
  search.gain_floor = options.gain_floor;
  search.initial_gains = WithinBounds(search, start);
  search.seed = options.seed + index;
  search.cma_es = {.population = 16,
                   .initial_sigma = index == 0 ? kSigmaOfBest : kSigmaOfOthers,
                   .restarts = SearchOptions::kMaxRestarts};
  return search;
}

EpisodeResult ToResult(const IterationRecord& record) {
  return {.outcome = record.outcome,
          .settling_samples = record.settling_samples,
          .fuel_sum = record.fuel_sum,
          .cost = record.cost};
}

RefineResult RefineFrom(const SearchOptions& search_options, const Evaluate& evaluate, const RefineOptions& options,
                        Clock::time_point deadline) {
  RefineResult best{.gains = search_options.initial_gains};
  const auto search = MakeOptimiser(search_options);
  std::vector<EpisodeResult> results;
  while (!search->done() && Clock::now() < deadline && !(options.cancelled && options.cancelled())) {
    results.assign(search->batch().size(), {});
    evaluate(search->batch(), results);
    const auto record = search->Update(results);
    if (!record.ok()) break;  // none of a batch has a cost: nothing is to be learnt from here
    best.episodes = record->episodes;
    if (BetterResult(ToResult(*record), best.result)) {
      best.gains = record->gains;
      best.result = ToResult(*record);
    }
  }
  return best;
}

}  // namespace

RefineResult Refine(std::span<const Gains> starts, const Evaluate& evaluate, const RefineOptions& options) {
  ORBITUNE_CHECK(!starts.empty());
  const Clock::time_point deadline = Clock::now() + options.budget;
  std::vector<RefineResult> found(starts.size());
  const auto run = [&](std::size_t i) {
    found[i] = RefineFrom(OptionsFor(starts[i], i, options), evaluate, options, deadline);
  };
  std::vector<std::thread> others;
  for (std::size_t i = 1; i < starts.size(); ++i) others.emplace_back(run, i);
  run(0);
  for (std::thread& other : others) other.join();
  RefineResult best = found.front();
  for (const RefineResult& one : std::span(found).subspan(1)) {
    const std::int64_t episodes = best.episodes + one.episodes;
    if (BetterResult(one.result, best.result)) best = one;
    best.episodes = episodes;
  }
  return best;
}

}  // namespace orbitune
