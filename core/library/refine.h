// A search from good gains for better ones within a wall time: what a query may spend when somebody waits for it.
#pragma once

#include <chrono>
#include <functional>
#include <span>

#include "core/search/options.h"
#include "core/search/search.h"

namespace orbitune {

struct RefineOptions {
  std::chrono::steady_clock::duration budget{};
  std::function<bool()> cancelled;  // asked between generations; true ends the search; none: never
  double gain_floor = SearchOptions{}.gain_floor;
  std::uint64_t seed = 1;
};

struct RefineResult {
  Gains gains{};         // the best flown
  EpisodeResult result;  // of theirs, by `evaluate`
  std::int64_t episodes = 0;
};

// CMA-ES over ln K (core/search/cma_es.h) from each of `starts`, the best known first, side by side on a thread each,
// until the budget is spent. evaluate: thread-safe. How far it gets depends on the machine, and so does the result.
RefineResult Refine(std::span<const Gains> starts, const Evaluate& evaluate, const RefineOptions& options);

}  // namespace orbitune
