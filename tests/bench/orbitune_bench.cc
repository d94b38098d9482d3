// orbitune_bench: our engines beside Boost.odeint on the same episodes, in one run, every cost checked against a run at
// a tolerance of 1e-12; and whole jobs. Exit status 1 if a cost is wrong.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <thread>

#include "core/sim/scalar_simulator.h"
#include "core/simd/lane_kernel.h"
#include "tests/bench/job_bench.h"
#include "tests/bench/median.h"
#include "tests/bench/odeint_engine.h"
#include "tests/bench/optimiser_bench.h"
#include "tests/bench/peak_fma.h"
#include "tests/bench/workload.h"
#include "tests/core/testing.h"

namespace orbitune::bench {
namespace {

using Clock = std::chrono::steady_clock;
using nlohmann::json;

// Operations of the kernel for one right-hand side and lane, counted in core/simd/lane_*-inl.h, a fused one as
// one: the closed loop's 62, and a sixth of a step's combinations (210), error estimate (90) and decision (50).
constexpr double kFmaSlotsPerRhs = 120;

struct Row {
  std::string workload;
  bool early_exit = true;
  std::string engine;
  std::string target;  // instruction set, of "lanes"
  double episodes_per_s_per_core = 0;
  double ns_per_rhs_lane = 0;
  double ratio_to_odeint = 0;
  double percent_of_peak = 0;  // of the machine's fused multiply-adds, of "lanes"
  int wrong_settling = 0;
  double worst_cost_error = 0;
};

void ToJson(json& out, const Row& row) {
  out.push_back({{"workload", row.workload},
                 {"early_exit", row.early_exit},
                 {"engine", row.engine},
                 {"target", row.target},
                 {"episodes_per_s_per_core", row.episodes_per_s_per_core},
                 {"ns_per_rhs_lane", row.ns_per_rhs_lane},
                 {"ratio_to_odeint", row.ratio_to_odeint},
                 {"percent_of_peak_fma", row.percent_of_peak},
                 {"wrong_settling", row.wrong_settling},
                 {"worst_cost_error", row.worst_cost_error}});
}

// One way to run a workload's episodes.
struct Engine {
  std::string name;
  std::string target;
  bool early_exit = true;
  std::size_t episodes = 0;  // of the workload's, from the first: slow engines fly fewer
  std::function<void(const Workload&, std::span<EpisodeResult>)> run;
};

void RunLanes(const Workload& w, bool early_exit, std::span<EpisodeResult> results) {
  std::vector<BatchEpisode> batch;
  for (const Gains& k : std::span(w.gains).first(results.size())) batch.push_back({&w.problem, k, early_exit});
  SimulateBatch(batch, results);
}

std::vector<Engine> MakeEngines(std::size_t count, double odeint_floor) {
  std::vector<Engine> engines;
  const std::size_t few = std::max<std::size_t>(count / 20, 1);
  engines.push_back({"odeint", "", false, few, [odeint_floor](const Workload& w, std::span<EpisodeResult> results) {
                       for (std::size_t i = 0; i < results.size(); ++i) {
                         results[i] = SimulateWithOdeint(w.problem, w.gains[i], odeint_floor);
                       }
                     }});
  for (const bool early_exit : {false, true}) {
    engines.push_back(
        {"scalar", "", early_exit, few, [early_exit](const Workload& w, std::span<EpisodeResult> results) {
           for (std::size_t i = 0; i < results.size(); ++i) {
             results[i] = SimulateEpisode(w.problem, w.gains[i], {.early_exit = early_exit});
           }
         }});
    for (const std::string& target : simd::SupportedTargets()) {
      engines.push_back({"lanes", target, early_exit, count,
                         [early_exit, target](const Workload& w, std::span<EpisodeResult> results) {
                           simd::UseTarget(target);
                           RunLanes(w, early_exit, results);
                         }});
    }
  }
  return engines;
}

std::vector<EpisodeResult> Reference(Workload w) {
  w.problem.tolerance = 1e-12;
  std::vector<EpisodeResult> results(w.gains.size());
  simd::UseTarget("auto");
  RunLanes(w, false, results);
  return results;
}

void Check(Row& row, std::span<const EpisodeResult> results, const std::vector<EpisodeResult>& reference) {
  for (std::size_t i = 0; i < results.size(); ++i) {
    if (results[i].settling_samples != reference[i].settling_samples) ++row.wrong_settling;
    row.worst_cost_error = std::max(row.worst_cost_error, std::abs(results[i].cost / reference[i].cost - 1));
  }
}

// Every engine on one workload, in turn, `repeats` times: the median of the paired ratios stands against noise.
std::vector<Row> Compare(const Workload& w, int repeats, double odeint_floor) {
  const auto reference = Reference(w);
  const auto engines = MakeEngines(w.gains.size(), odeint_floor);
  std::vector<std::vector<double>> seconds(engines.size());  // of an episode, by engine and repeat
  std::vector<Row> rows;
  for (int repeat = 0; repeat < repeats; ++repeat) {
    for (std::size_t e = 0; e < engines.size(); ++e) {
      const Engine& engine = engines[e];
      std::vector<EpisodeResult> results(engine.episodes);
      const auto begin = Clock::now();
      engine.run(w, results);
      const double elapsed = std::chrono::duration<double>(Clock::now() - begin).count();
      seconds[e].push_back(elapsed / static_cast<double>(results.size()));
      if (repeat != 0) continue;
      Row& row = rows.emplace_back(Row{w.name, engine.early_exit, engine.name, engine.target});
      Check(row, results, reference);
      double rhs = 0;
      for (const EpisodeResult& r : results) rhs += 6.0 * (r.steps + r.rejected_steps);
      row.ns_per_rhs_lane = rhs / static_cast<double>(results.size());  // for now: their number
    }
  }
  for (std::size_t e = 0; e < engines.size(); ++e) {
    std::vector<double> ratios;
    for (std::size_t r = 0; r < seconds[e].size(); ++r) ratios.push_back(seconds[0][r] / seconds[e][r]);
    const double median = Median(seconds[e]);
    rows[e].episodes_per_s_per_core = 1 / median;
    rows[e].ns_per_rhs_lane = 1e9 * median / rows[e].ns_per_rhs_lane;
    rows[e].ratio_to_odeint = Median(ratios);
    if (engines[e].name != "lanes") continue;
    simd::UseTarget(engines[e].target);
    rows[e].percent_of_peak = 100 * kFmaSlotsPerRhs / (1e-9 * rows[e].ns_per_rhs_lane) / PeakFmaPerSecond();
  }
  simd::UseTarget("auto");
  return rows;
}

// Random gains (0.03 to 30), scenarios and initial conditions, as the tests draw them: what the default tolerance is
// chosen by.
Row RunRandom(int count, double tolerance) {
  std::vector<testing::RandomEpisode> drawn;
  for (int i = 0; i < count; ++i) drawn.push_back(testing::DrawEpisode(20'000 + i));
  std::vector<EpisodeResult> reference(drawn.size());
  std::vector<EpisodeResult> results(drawn.size());
  const auto fly = [&](double to, std::span<EpisodeResult> out) {
    for (testing::RandomEpisode& episode : drawn) episode.problem.tolerance = to;
    const std::size_t cores = std::max(1U, std::thread::hardware_concurrency());
    const std::size_t share = (drawn.size() + cores - 1) / cores;
    std::vector<std::jthread> threads;
    for (std::size_t begin = 0; begin < drawn.size(); begin += share) {
      threads.emplace_back([&drawn, out, begin, count = std::min(share, drawn.size() - begin)] {
        std::vector<BatchEpisode> batch;
        for (const auto& e : std::span(drawn).subspan(begin, count)) batch.push_back({&e.problem, e.gains});
        SimulateBatch(batch, out.subspan(begin, count));
      });
    }
    const std::size_t used = threads.size();
    const auto start = Clock::now();
    threads.clear();
    return std::chrono::duration<double>(Clock::now() - start).count() * static_cast<double>(used);
  };
  simd::UseTarget("auto");
  // Where a very fine flight would take too many steps, a less fine one is the reference.
  for (const double to : {1e-8, 1e-10, 1e-12}) {
    fly(to, results);
    for (std::size_t i = 0; i < drawn.size(); ++i) {
      if (results[i].outcome != Outcome::kNumericalFailure || to == 1e-8) reference[i] = results[i];
    }
  }
  const double seconds = fly(tolerance, results);
  Row row{.workload = "random", .engine = "lanes", .target = simd::TargetInUse()};
  double rhs = 0;
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    rhs += 6.0 * (results[i].steps + results[i].rejected_steps);
    if (results[i].outcome != reference[i].outcome || results[i].settling_samples != reference[i].settling_samples) {
      ++row.wrong_settling;
    } else if (HasCost(results[i].outcome)) {
      row.worst_cost_error = std::max(row.worst_cost_error, std::abs(results[i].cost / reference[i].cost - 1));
    }
  }
  row.episodes_per_s_per_core = static_cast<double>(drawn.size()) / seconds;
  row.ns_per_rhs_lane = 1e9 * seconds / rhs;
  return row;
}

void PrintHeader() {
  std::printf("%-24s %-6s %-8s %-5s %14s %10s %10s %7s %6s %9s\n", "workload", "engine", "target", "early",
              "episodes/s", "ns/rhs", "x odeint", "% peak", "wrong", "error J");
}

void Print(const Row& r) {
  std::printf("%-24s %-6s %-8s %-5s %14.0f %10.2f %10.1f %7.1f %6d %9.1e\n", r.workload.c_str(), r.engine.c_str(),
              r.target.c_str(), r.early_exit ? "yes" : "no", r.episodes_per_s_per_core, r.ns_per_rhs_lane,
              r.ratio_to_odeint, r.percent_of_peak, r.wrong_settling, r.worst_cost_error);
}

void AddJobs(json& out, bool as_json, const JobRow& r) {
  json& row = out.emplace_back(json{{"workload", "jobs/gto-geo"},
                                    {"what", r.what},
                                    {"jobs", r.jobs},
                                    {"threads", r.threads},
                                    {"iterations", r.iterations},
                                    {"seconds", r.seconds},
                                    {"iterations_per_s", r.iterations_per_s},
                                    {"worst_reduction_percent", r.worst_reduction_percent}});
  if (r.iterations_per_message > 0) row["iterations_per_message"] = r.iterations_per_message;
  if (r.added_percent) row["added_percent"] = *r.added_percent;
  if (as_json) return;
  std::printf("%-7s %3d jobs of %d iterations, %d threads: %7.3f s, %9.0f iterations/s (reductions of %.1f %% or more)",
              r.what.c_str(), r.jobs, r.iterations, r.threads, r.seconds, r.iterations_per_s,
              r.worst_reduction_percent);
  if (r.added_percent) std::printf("; %+.1f %% with %d to a message", *r.added_percent, r.iterations_per_message);
  std::printf("\n");
  std::fflush(stdout);
}

void RunJobs(json& rows, int iterations, int repeats, bool as_json) {
  const int cores = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  for (int threads = 1; threads <= std::max(2, cores); threads *= 2) {
    for (const JobRow& row : CompareServerWithEngine(threads, iterations, repeats)) AddJobs(rows, as_json, row);
  }
  AddJobs(rows, as_json, RunThroughServer(50, cores, iterations, kIterationsPerMessage));
}

void PrintOptimisers(json& out, bool as_json, const std::vector<OptimiserRow>& rows) {
  if (!as_json) {
    std::printf("%-16s %-26s %9s %10s %8s %8s %10s %8s\n", "scenario", "optimiser", "episodes", "reduction%", "min",
                "max", "mean J", "s/IC");
  }
  for (const OptimiserRow& r : rows) {
    out.push_back({{"scenario", r.scenario},
                   {"optimiser", r.optimiser},
                   {"episodes", r.episodes},
                   {"mean_reduction_percent", r.mean_percent},
                   {"min_reduction_percent", r.min_percent},
                   {"max_reduction_percent", r.max_percent},
                   {"mean_cost", r.mean_cost},
                   {"seconds_per_initial_condition", r.seconds}});
    if (as_json) continue;
    std::printf("%-16s %-26s %9lld %10.1f %8.1f %8.1f %10.3f %8.3f\n", r.scenario.c_str(), r.optimiser.c_str(),
                static_cast<long long>(r.episodes), r.mean_percent, r.min_percent, r.max_percent, r.mean_cost,
                r.seconds);
  }
}

int Main(int argc, char** argv) {
  CLI::App app("Times episodes and whole jobs, beside Boost.odeint, and checks every cost.", "orbitune_bench");
  bool as_json = false;
  bool no_jobs = false;
  int episodes = 400;
  int repeats = 5;
  int iterations = 2000;
  int job_repeats = 15;
  int random = 10'000;
  double tolerance = kDefaultIntegrationTolerance;
  double odeint_floor = 1e-2;
  std::string only;
  app.add_flag("--json", as_json, "An array of rows: the episodes', then the jobs'");
  app.add_flag("--no-jobs", no_jobs, "Episodes only");
  app.add_option("--episodes", episodes, "Of each workload; the scalar engines fly a twentieth")
      ->check(CLI::Range(20, 100'000))
      ->capture_default_str();
  app.add_option("--repeats", repeats)->check(CLI::Range(1, 1000))->capture_default_str();
  app.add_option("--iterations", iterations, "Of each job")->check(CLI::Range(1, 1'000'000))->capture_default_str();
  app.add_option("--job-repeats", job_repeats, "Of one job, by the engine and through the server; medians are printed")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--random", random, "How many random episodes")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  app.add_option("--tolerance", tolerance, "Of the integration")->capture_default_str();
  app.add_option("--odeint-floor", odeint_floor,
                 "Settling distances: its absolute tolerance is this times the tolerance")
      ->capture_default_str();
  app.add_option("--workload", only, "Only this one, e.g. gto-geo/tuned, or random");
  bool only_optimisers = false;
  OptimiserBenchOptions optimisers{.threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()))};
  app.add_flag("--optimisers", only_optimisers, "Only the optimisers at equal episodes, over drawn initial conditions");
  app.add_option("--ics", optimisers.initial_conditions, "Of the optimisers: initial conditions of each scenario")
      ->check(CLI::Range(1, 10'000))
      ->capture_default_str();
  app.add_option("--budget", optimisers.budget, "Of the optimisers: episodes for each initial condition")
      ->check(CLI::Range(200, 100'000'000))
      ->capture_default_str();
  app.add_option("--ic-seed", optimisers.seed, "Of the initial conditions and searches")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  if (only_optimisers) {
    json compared = json::array();
    PrintOptimisers(compared, as_json, CompareOptimisers(optimisers));
    if (as_json) std::cout << compared.dump(1) << '\n';
    return 0;
  }

  json rows = json::array();
  bool wrong = false;
  if (!as_json) PrintHeader();
  const auto add = [&](const Row& row) {
    wrong = wrong || row.wrong_settling > 0 || !(row.worst_cost_error <= 1e-5);
    ToJson(rows, row);
    if (!as_json) Print(row);
  };
  for (const Workload& workload : MakeWorkloads(episodes, tolerance)) {
    if (!only.empty() && workload.name != only) continue;
    for (const Row& row : Compare(workload, repeats, odeint_floor)) add(row);
  }
  if (random > 0 && (only.empty() || only == "random")) add(RunRandom(random, tolerance));
  if (!no_jobs) RunJobs(rows, iterations, job_repeats, as_json);
  if (as_json) std::cout << rows.dump(1) << '\n';
  if (wrong) std::fprintf(stderr, "orbitune_bench: a cost is wrong\n");
  return wrong ? 1 : 0;
}

}  // namespace
}  // namespace orbitune::bench

int main(int argc, char** argv) { return orbitune::bench::Main(argc, argv); }
