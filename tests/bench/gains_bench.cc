// orbitune_bench_gains: what the gain library costs, with every result checked against a search one by one
// (--mode latency), and how good its answers are (--mode quality). docs/benchmarks.md says how it is run.
#include <grpcpp/grpcpp.h>
#include <time.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <future>
#include <numeric>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/random.h"
#include "core/library/scenario_digest.h"
#include "core/scenario/presets.h"
#include "orbitune/v1/gains.grpc.pb.h"
#include "server/convert/orbit.h"
#include "server/jobs/gain_sets.h"
#include "server/rpc/server.h"
#include "storage/sqlite_store.h"
#include "tests/bench/gains_evaluation.h"

namespace orbitune::bench {
namespace {

using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

struct Options {
  std::string mode = "latency";
  int sets = 100'000;
  int queries = 500;
  int candidates = 64;
  EvaluationOptions evaluation;
};

const Scenario& Leo() { return *FindPreset("leo-rendezvous"); }

OrbitState Start(DrawSet set, std::uint32_t index) {
  auto start = Draw(Leo().neighbourhood, 1, set, index);
  ORBITUNE_CHECK(start.ok());
  return *std::move(start);
}

// Gains about as good as tuned ones: those of one, each changed by some tens of percent.
GainSet MakeSet(int index, const std::vector<Gains>& tuned) {
  GainSet set;
  set.id = absl::StrCat("set", index);
  set.create_time_us = index;
  for (std::uint32_t i = 0; i < kGainCount; ++i) {
    const double z = StandardNormal({.seed = 7, .a = static_cast<std::uint32_t>(index)}, i);
    set.gains[i] = tuned[static_cast<std::size_t>(index) % tuned.size()][i] * std::exp(0.2 * z);
  }
  set.initial_condition = Start(DrawSet::kTuning, static_cast<std::uint32_t>(index));
  const auto prepared = Prepare(Leo(), set.initial_condition);
  ORBITUNE_CHECK(prepared.ok());
  set.initial_error = prepared->problem.initial_error;
  set.velocity_unit_m_s = prepared->velocity_unit_m_s;
  set.acceleration_unit_m_s2 = prepared->acceleration_unit_m_s2;
  set.scenario = LibraryDefinition(Leo());
  set.scenario_digest = ScenarioDigest(Leo());
  set.algorithm = "CMA_ES";
  return set;
}

std::vector<GainSet> StoreSets(JobStore& store, int count) {
  const std::vector<Gains> tuned = TunedGains(16, {.episodes = 1500});
  std::vector<GainSet> sets;
  for (int i = 0; i < count; ++i) sets.push_back(MakeSet(i, tuned));
  std::promise<absl::Status> stored;
  store.gains().AddGainSets(sets, [&stored](absl::Status status) { stored.set_value(std::move(status)); });
  ORBITUNE_CHECK(stored.get_future().get().ok());
  return sets;
}

// ---- the index alone

using Point = std::array<double, 6>;
Point PointOf(const ErrorState& x) { return {x.x1, x.x2, x.x3, x.x4, x.x5, x.x6}; }

// Distances from x to all, in the spread that the library is said to use.
std::vector<double> AllDistances(const std::vector<GainSet>& sets, const Point& spread, const ErrorState& x) {
  std::vector<double> distances;
  for (const GainSet& set : sets) {
    double sum = 0;
    for (std::size_t i = 0; i < 6; ++i) {
      sum += std::pow((PointOf(*set.initial_error)[i] - PointOf(x)[i]) / spread[i], 2);
    }
    distances.push_back(std::sqrt(sum));
  }
  return distances;
}

Point SpreadOf(const std::vector<GainSet>& sets, double least) {
  Point mean{}, variance{};
  const double n = static_cast<double>(sets.size());
  for (const GainSet& set : sets) {
    for (std::size_t i = 0; i < 6; ++i) mean[i] += PointOf(*set.initial_error)[i] / n;
  }
  for (const GainSet& set : sets) {
    for (std::size_t i = 0; i < 6; ++i) variance[i] += std::pow(PointOf(*set.initial_error)[i] - mean[i], 2) / n;
  }
  for (double& v : variance) v = std::max(std::sqrt(v), least);
  return variance;
}

void CheckIndex(const ScenarioLibrary& library, const std::vector<GainSet>& sets, double settling_distance,
                std::size_t count) {
  const Point spread = SpreadOf(sets, settling_distance);
  for (std::uint32_t i = 0; i < 20; ++i) {
    const ErrorState x = Prepare(Leo(), Start(DrawSet::kHeldOut, i))->problem.initial_error;
    std::vector<double> expected = AllDistances(sets, spread, x);
    std::ranges::sort(expected);
    const auto nearest = library.Around(x, count, 0).nearest;
    ORBITUNE_CHECK(nearest.size() == std::min(count, sets.size()));
    for (std::size_t j = 0; j < nearest.size(); ++j) {
      ORBITUNE_CHECK(std::abs(nearest[j].distance - expected[j]) <= 1e-9 * (1 + expected[j]));
    }
  }
}

void BenchIndex(const ScenarioLibrary& library, const Options& options) {
  std::vector<ErrorState> starts;
  for (std::uint32_t i = 0; i < 200; ++i) {
    starts.push_back(Prepare(Leo(), Start(DrawSet::kHeldOut, i))->problem.initial_error);
  }
  const auto begin = Clock::now();
  int queries = 0;
  double sum = 0;
  for (; SecondsSince(begin) < 1; ++queries) {
    sum += library
               .Around(starts[static_cast<std::size_t>(queries) % starts.size()],
                       static_cast<std::size_t>(options.candidates), 16)
               .nearest.front()
               .distance;
  }
  std::printf("index: %d nearest of %zu: %.0f queries/s (mean nearest distance %.3g)\n", options.candidates,
              library.size(), queries / SecondsSince(begin), sum / queries);
}

// ---- whole queries

void Report(const char* what, std::vector<double> seconds) {
  std::ranges::sort(seconds);
  const auto at = [&](double q) { return 1e3 * seconds[static_cast<std::size_t>(q * double(seconds.size() - 1))]; };
  std::printf("%s: p50 %.3f ms, p90 %.3f ms, p99 %.3f ms, max %.3f ms\n", what, at(0.5), at(0.9), at(0.99), at(1));
}

// Tells what a query costs on a machine with other work, too.
double ThreadCpuSeconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

void BenchUseCase(GainUseCases& gains, const Options& options) {
  std::vector<double> seconds;
  std::vector<double> cpu_seconds;
  for (int i = 0; i < options.queries; ++i) {
    GainQuery query{.scenario = {.preset_id = "leo-rendezvous", .definition = {}},
                    .initial_condition = Start(DrawSet::kHeldOut, static_cast<std::uint32_t>(i)),
                    .max_candidates = options.candidates};
    const auto begin = Clock::now();
    const double cpu_begin = ThreadCpuSeconds();
    const auto answer = gains.Query(query);
    cpu_seconds.push_back(ThreadCpuSeconds() - cpu_begin);
    seconds.push_back(SecondsSince(begin));
    ORBITUNE_CHECK(answer.ok() && answer->result.settled() && answer->result.candidates == options.candidates);
  }
  Report("QueryGains, in the process", std::move(seconds));
  Report("  of that, processor time", std::move(cpu_seconds));
}

void BenchRpc(UseCases& use_cases, CampaignUseCases& campaigns, GainUseCases& gains, const Options& options) {
  Api api(use_cases, campaigns, gains);
  auto server = RpcServer::Start("127.0.0.1:0", api);
  ORBITUNE_CHECK(server.ok());
  const auto stub =
      v1::GainService::NewStub(grpc::CreateChannel((*server)->address(), grpc::InsecureChannelCredentials()));
  std::vector<double> seconds;
  for (int i = -20; i < options.queries; ++i) {
    v1::QueryGainsRequest request;
    request.set_scenario("scenarios/leo-rendezvous");
    request.set_max_candidates(options.candidates);
    ToProto(Start(DrawSet::kHeldOut, static_cast<std::uint32_t>(i + 20)), request.mutable_initial_condition());
    v1::QueryGainsResponse response;
    grpc::ClientContext context;
    const auto begin = Clock::now();
    const grpc::Status status = stub->QueryGains(&context, request, &response);
    if (i >= 0) seconds.push_back(SecondsSince(begin));
    ORBITUNE_CHECK(status.ok() && response.settled() && response.answers_size() == 5);
    for (int j = 1; j < response.answers_size(); ++j) {
      ORBITUNE_CHECK(!response.answers(j).flight().certificate().settled() ||
                     response.answers(j - 1).flight().cost() <= response.answers(j).flight().cost());
    }
  }
  Report("QueryGains, over gRPC at one client", std::move(seconds));
  (*server)->Shutdown(std::chrono::seconds(1));
}

void RunLatency(const Options& options) {
  const auto folder = std::filesystem::temp_directory_path() / absl::StrCat("orbitune_bench_gains_", getpid());
  std::filesystem::create_directories(folder);
  const std::string path = (folder / "orbitune.db").string();
  std::vector<GainSet> sets;
  {
    auto store = OpenSqliteStore({.path = path});
    ORBITUNE_CHECK(store.ok());
    const auto begin = Clock::now();
    sets = StoreSets(**store, options.sets);
    std::printf("stored %d gain sets in %.2f s\n", options.sets, SecondsSince(begin));
  }
  {
    const auto begin = Clock::now();
    auto store = OpenSqliteStore({.path = path});
    ORBITUNE_CHECK(store.ok());
    GainLibrary library;
    ORBITUNE_CHECK(LoadLibrary((*store)->gains(), library).ok());
    std::printf("start: %d gain sets from the disk to the index in %.3f s (database of %.0f MB)\n", options.sets,
                SecondsSince(begin), static_cast<double>(std::filesystem::file_size(path)) / 1e6);
    const auto leo = library.Find(ScenarioDigest(Leo()));
    ORBITUNE_CHECK(leo != nullptr && leo->size() == sets.size());
    CheckIndex(*leo, sets, Prepare(Leo())->problem.settling_distance, static_cast<std::size_t>(options.candidates));
    BenchIndex(*leo, options);
    EventHub hub;
    Scheduler scheduler(**store, hub, {.threads = 1});
    UseCases use_cases(**store, scheduler, hub);
    GainUseCases gains(**store, library);
    BenchUseCase(gains, options);
    CampaignEngine campaign_engine(**store, (*store)->campaigns(), scheduler, hub);
    CampaignUseCases campaigns(use_cases, (*store)->campaigns(), campaign_engine);
    BenchRpc(use_cases, campaigns, gains, options);
  }
  std::filesystem::remove_all(folder);
}

void RunQuality(const EvaluationOptions& options) {
  const auto begin = Clock::now();
  const EvaluationRow row = Evaluate(options);
  std::printf("%d held-out starts of leo-rendezvous, a library of %d, each tuned with %d episodes of CMA-ES (%.0f s)\n",
              options.held_out, options.tuned, options.episodes, SecondsSince(begin));
  std::printf("cost over that of tuning the very start   mean    worst\n");
  std::printf("  K-hat                                 %6.3f\n", row.mean_gains_mean);
  std::printf("  robust K                              %6.3f\n", row.robust_mean);
  std::printf("  QueryGains                            %6.3f   %6.3f\n", row.query_mean, row.query_worst);
  std::printf("  QueryGains, refined for %d ms        %6.3f   %6.3f\n", options.refine_ms, row.refined_mean,
              row.refined_worst);
  std::printf("answers worse than K-hat: %d, than the robust K: %d; extrapolated: %d; episodes of a refinement: %.0f\n",
              row.worse_than_mean_gains, row.worse_than_robust, row.extrapolated, row.refine_episodes);
}

int Main(int argc, char** argv) {
  Options options;
  CLI::App app("What the gain library costs, and how good its answers are.");
  app.add_option("--mode", options.mode)->check(CLI::IsMember({"latency", "quality"}))->capture_default_str();
  app.add_option("--sets", options.sets, "Gain sets stored")->check(CLI::Range(100, 10'000'000))->capture_default_str();
  app.add_option("--queries", options.queries)->check(CLI::Range(1, 1'000'000))->capture_default_str();
  app.add_option("--candidates", options.candidates)->check(CLI::Range(1, 1024))->capture_default_str();
  app.add_option("--tuned", options.evaluation.tuned)->check(CLI::Range(2, 10'000))->capture_default_str();
  app.add_option("--held-out", options.evaluation.held_out)->check(CLI::Range(1, 10'000))->capture_default_str();
  app.add_option("--episodes", options.evaluation.episodes)->check(CLI::Range(100, 1'000'000))->capture_default_str();
  app.add_option("--refine-ms", options.evaluation.refine_ms)->check(CLI::Range(1, 10'000))->capture_default_str();
  app.add_option("--seed", options.evaluation.seed)->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  options.mode == "quality" ? RunQuality(options.evaluation) : RunLatency(options);
  return 0;
}

}  // namespace
}  // namespace orbitune::bench

int main(int argc, char** argv) { return orbitune::bench::Main(argc, argv); }
