// orbitune_soak: the server under 1,000 gRPC and 500 SSE watchers and 32 clients that submit jobs and follow them, for
// as long as it is told, with restarts if wanted. The watched jobs are a few that go on for ever, at some ten
// iterations a second each beside the others; every other watcher takes each event, the rest the latest.
//
// The time is cut into two halves, alike but for a tenth of the watchers, which stalls in the second. What is checked:
// every watcher's sequence; no error but the documented refusals; and, unless --correctness-only, memory, descriptors
// and threads, the 99th percentile of unary calls, and that the stalled tenth changes it for nobody.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <thread>

#include "tests/soak/grpc_watchers.h"
#include "tests/soak/journal.h"
#include "tests/soak/server_process.h"
#include "tests/soak/sse_watchers.h"
#include "tests/soak/submitters.h"

namespace orbitune::soak {
namespace {

struct Options {
  double seconds = 600;
  int grpc_watchers = 1000;
  int sse_watchers = 500;
  int submitters = 32;
  int jobs = 10;
  int restarts = 0;
  double pause_s = 0.1;
  double stalled = 0.1;
  double most_memory_mib = 400;
  double most_call_ms = 50;
  double most_change = 0.2;
  bool correctness_only = false;
  std::string directory;
  std::vector<std::string> server_arguments;
};

// A half: what the server had, second by second, and how long calls took in it.
struct Half {
  std::vector<Usage> usage;
  double call_p50_ms = 0;
  double call_p99_ms = 0;
  double behind_p99_ms = 0;
};

class Soak {
 public:
  explicit Soak(const Options& options) : options_(options), server_(options.directory, options.server_arguments) {}

  int Run() {
    for (int i = 0; i < options_.jobs; ++i) {
      jobs_.push_back(std::make_unique<WatchedJob>());
      jobs_.back()->name = CreateEndlessJob(server_.grpc_address(), i);
    }
    GrpcWatchers grpc(server_.grpc_address(), options_.grpc_watchers, jobs_, journal_);
    SseWatchers sse(server_.http_address(), options_.sse_watchers, jobs_, journal_);
    Submitters submitters(server_.grpc_address(), options_.submitters, options_.pause_s, journal_);
    Watch(std::min(10.0, options_.seconds / 10), nullptr);  // until all are there
    for (int i = 0; i < options_.restarts; ++i) Restart(grpc);
    Half whole, stalled;
    Watch(options_.seconds / 2, &whole);
    grpc.Stall(static_cast<int>(options_.grpc_watchers * options_.stalled));
    sse.Stall(static_cast<int>(options_.sse_watchers * options_.stalled));
    Watch(options_.seconds / 2, &stalled);
    grpc.GoOn();
    sse.Stall(0);
    Watch(std::min(10.0, options_.seconds / 10), nullptr);  // they catch up
    journal_.stopping = true;
    grpc.Stop();
    sse.Stop();
    submitters.Stop();
    std::printf("stopped in %.2f s\n", server_.Stop());
    return Report(whole, stalled);
  }

 private:
  void Watch(double seconds, Half* half) {
    journal_.call_time.Clear();
    journal_.behind_first.Clear();
    const auto end = Clock::now() + std::chrono::duration<double>(seconds);
    while (Clock::now() < end) {
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
      if (half != nullptr) half->usage.push_back(server_.Now());
    }
    if (half == nullptr) return;
    half->call_p50_ms = journal_.call_time.Percentile_ms(0.5);
    half->call_p99_ms = journal_.call_time.Percentile_ms(0.99);
    half->behind_p99_ms = journal_.behind_first.Percentile_ms(0.99);
  }

  void Restart(GrpcWatchers& grpc) {
    journal_.restarting = true;
    std::printf("restart: stopped in %.2f s\n", server_.Stop());
    server_.Start();
    // Long enough for whoever has just been refused to have been here again.
    for (int i = 0; i < 30; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
      grpc.GoOn();
    }
    journal_.restarting = false;
  }

  void Check(bool good, const std::string& what) {
    std::printf("%s %s\n", good ? "ok    " : "FAILED", what.c_str());
    failed_ = failed_ || !good;
  }

  static void Print(const char* name, const Half& half) {
    if (half.usage.empty()) return;
    const Usage& last = half.usage.back();
    std::printf(
        "%-16s calls p50 %.1f ms, p99 %.1f ms; watchers behind the first: p99 %.1f ms; at its end %.0f MiB, %d fds, "
        "%d threads\n",
        name, half.call_p50_ms, half.call_p99_ms, half.behind_p99_ms, last.resident_mib, last.descriptors,
        last.threads);
  }

  // Whether the last third of all samples is above the third before it.
  template <typename Member>
  static bool LevelsOff(const std::vector<Usage>& usage, Member member, double slack) {
    const std::size_t third = usage.size() / 3;
    const auto most = [&](std::size_t from, std::size_t to) {
      double largest = 0;
      for (std::size_t i = from; i < to; ++i) largest = std::max(largest, static_cast<double>(usage[i].*member));
      return largest;
    };
    return most(2 * third, usage.size()) <= most(third, 2 * third) * 1.05 + slack;
  }

  int Report(const Half& whole, const Half& stalled) {
    Print("all read", whole);
    Print("a tenth stalled", stalled);
    std::printf(
        "%lld calls, %lld jobs ended, %lld gRPC events, %lld SSE events, %lld refusals, %lld watchers cut off\n",
        Count(journal_.calls), Count(journal_.jobs_ended), Count(journal_.grpc_events), Count(journal_.sse_events),
        Count(journal_.refusals), Count(journal_.cut_off));
    for (const std::string& fault : journal_.faults()) std::printf("fault: %s\n", fault.c_str());
    Check(journal_.fault_count == 0, "no error but the documented refusals: " + std::to_string(journal_.fault_count));
    Check(journal_.jobs_ended > 0 && journal_.grpc_events > 0 && journal_.sse_events > 0, "everybody got something");
    if (options_.correctness_only) return failed_ ? 1 : 0;
    std::vector<Usage> usage = whole.usage;
    usage.insert(usage.end(), stalled.usage.begin(), stalled.usage.end());
    double most_mib = 0;
    for (const Usage& u : usage) most_mib = std::max(most_mib, u.resident_mib);
    Check(most_mib < options_.most_memory_mib, "memory: " + std::to_string(most_mib) + " MiB at most");
    Check(LevelsOff(usage, &Usage::resident_mib, 5), "memory levels off");
    Check(LevelsOff(usage, &Usage::descriptors, 20), "descriptors level off");
    Check(LevelsOff(usage, &Usage::threads, 5), "threads level off");
    Check(whole.call_p99_ms < options_.most_call_ms,
          "p99 of unary calls: " + std::to_string(whole.call_p99_ms) + " ms");
    const auto change = [](double before, double after) { return after / std::max(before, 1.0) - 1; };
    Check(change(whole.call_p99_ms, stalled.call_p99_ms) < options_.most_change,
          "p99 of unary calls with a tenth stalled: " + std::to_string(stalled.call_p99_ms) + " ms");
    Check(change(whole.behind_p99_ms, stalled.behind_p99_ms) < options_.most_change,
          "p99 of watchers behind the first with a tenth stalled: " + std::to_string(stalled.behind_p99_ms) + " ms");
    return failed_ ? 1 : 0;
  }

  static long long Count(const std::atomic<std::int64_t>& count) { return count.load(); }

  const Options options_;
  ServerProcess server_;
  std::vector<std::unique_ptr<WatchedJob>> jobs_;
  Journal journal_;
  bool failed_ = false;
};

}  // namespace
}  // namespace orbitune::soak

int main(int argc, char** argv) {
  orbitune::soak::Options options;
  CLI::App app("orbitune_soak: the server under many clients of every kind, for a while.", "orbitune_soak");
  app.add_option("--seconds", options.seconds, "For so long")->capture_default_str();
  app.add_option("--grpc-watchers", options.grpc_watchers)->capture_default_str();
  app.add_option("--sse-watchers", options.sse_watchers)->capture_default_str();
  app.add_option("--submitters", options.submitters)->capture_default_str();
  app.add_option("--jobs", options.jobs, "That are watched")->check(CLI::Range(1, 1000))->capture_default_str();
  app.add_option("--restarts", options.restarts, "Before the first half")->capture_default_str();
  app.add_option("--pause-s", options.pause_s, "Between two calls of a client")->capture_default_str();
  app.add_option("--stalled", options.stalled, "Part of the watchers that stall in the second half")
      ->capture_default_str();
  app.add_flag("--correctness-only", options.correctness_only, "Leave out what depends on the machine");
  app.add_option("--directory", options.directory, "Keep the data and the log there; else they are removed");
  app.add_option("--server-argument", options.server_arguments, "For orbituned; may be given again");
  CLI11_PARSE(app, argc, argv);
  const bool own = options.directory.empty();
  if (own) {
    std::string name = (std::filesystem::temp_directory_path() / "orbitune-soak-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) return 1;
    options.directory = name;
  }
  std::filesystem::create_directories(options.directory);
  const int status = orbitune::soak::Soak(options).Run();
  if (own && status == 0) std::filesystem::remove_all(options.directory);
  if (own && status != 0) std::printf("the server's data and log: %s\n", options.directory.c_str());
  return status;
}
