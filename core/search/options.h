// The options of a search over gains: which algorithm, its parameters, and when it ends.
#pragma once

#include <cstdint>

#include "core/control/gains.h"

namespace orbitune {

enum class Algorithm { kArs, kCmaEs, kNelderMead };

// How a parameter falls with the iteration i of M.
enum class Schedule {
  kConstant,
  kLinear,       // by 1 - (i - 1) / M
  kInverseSqrt,  // by 1 / sqrt(i)
};

// Departures from the paper's Algorithm 1; as they stand here, there is none.
struct ArsVariants {
  int top_directions = 0;  // b: only the b directions with the least cost move K; 0: all N
  Schedule step_schedule = Schedule::kConstant;
  Schedule exploration_schedule = Schedule::kConstant;
  bool log_gains = false;  // over ln K: alpha, sigma and exploration_std / K(1) are relative changes then
};

struct CmaEsOptions {
  int population = 16;           // candidates in a generation
  double initial_sigma = 0.5;    // standard deviation of ln K at the start
  int restarts = 1;              // runs after the first
  double population_growth = 1;  // population of a run over that of the one before; 2: IPOP
};

struct NelderMeadOptions {
  double initial_step = 0.5;  // edge of the first simplex in ln K
  int restarts = 3;           // simplices after the first
};

// Ends a search whose best cost has not fallen by `min_improvement` of itself for so many iterations.
struct PlateauStop {
  int iterations = 0;  // 0: never
  double min_improvement = 1e-3;
};

struct SearchOptions {
  int iterations = 2000;            // M: batches, whatever the algorithm
  double step_size = 5e-3;          // alpha, of ARS
  double exploration_scale = 2e-3;  // sigma, of ARS
  int directions = 16;              // N, of ARS
  Gains initial_gains{0.1, 1, 1, 1, 10};
  Gains exploration_std{1, 1, 1, 1, 1};  // of delta_j, one value per gain: sqrt(diag(Sigma_delta)); of ARS
  double gain_floor = 1e-3;              // every gain simulated is at least this
  std::uint64_t seed = 1;
  Algorithm algorithm = Algorithm::kArs;
  std::int64_t max_episodes = 0;  // the search never flies more; 0: no bound but M
  PlateauStop plateau_stop;
  ArsVariants ars_variants;
  CmaEsOptions cma_es;
  NelderMeadOptions nelder_mead;

  static constexpr int kMaxIterations = 10'000'000;
  static constexpr int kMaxDirections = 1024;
  static constexpr int kMaxPopulation = 1024;
  static constexpr int kMaxRestarts = 1000;
  static constexpr double kMaxGain = 1e6;
  static constexpr std::int64_t kMaxEpisodes = 1'000'000'000'000;
  // Of CMA-ES and Nelder-Mead, for each initial condition, where a user sets no bound.
  static constexpr std::int64_t kDefaultEpisodes = 6000;

  // OK, or INVALID_ARGUMENT with every field that is out of range, nested ones as "cma_es.population".
  absl::Status Validate() const;
};

// K raised to the floor where it is below it, and lowered to kMaxGain.
Gains WithinBounds(const SearchOptions& options, Gains gains);

}  // namespace orbitune
