// What one appended iteration costs the writer, and its digest the worker: append_benchmark DIRECTORY [ITERATIONS
// [JOBS]]. Not a test.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>

#include "core/library/history_digest.h"
#include "storage/sqlite_store.h"
#include "tests/storage/store_support.h"

namespace {

using orbitune::JobStore;
using orbitune::storage_test::Create;
using orbitune::storage_test::RecordOf;

double Seconds(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

// Iterations first..last of every job, all queued at once or one at a time.
void Run(JobStore& store, int jobs, int first, int last, bool one_at_a_time, const char* name) {
  const auto begin = std::chrono::steady_clock::now();
  orbitune::Digest digest{};
  for (int i = first; i <= last; ++i) {
    for (int j = 0; j < jobs; ++j) {
      digest = orbitune::ExtendHistory(digest, RecordOf(i));
      store.AppendIteration("job-" + std::to_string(j), i + 1, RecordOf(i), {.digest = digest},
                            [](const absl::Status& status) {
                              if (!status.ok()) std::abort();
                            });
      if (one_at_a_time) store.Flush();
    }
  }
  store.Flush();
  const int count = jobs * (last - first + 1);
  std::printf("%-14s %8d iterations of %d jobs: %.2f us each\n", name, count, jobs, 1e6 * Seconds(begin) / count);
}

void RunDigests(int count) {
  const auto begin = std::clock();  // processor time: short beside what else may run
  orbitune::Digest digest{};
  for (int i = 1; i <= count; ++i) digest = orbitune::ExtendHistory(digest, RecordOf(i));
  const auto again = std::clock();
  double sum = 0;
  for (int i = 1; i <= count; ++i) sum += RecordOf(i).gains[0];
  const auto end = std::clock();
  const double seconds = static_cast<double>(again - begin - (end - again)) / CLOCKS_PER_SEC;
  std::printf("%-14s %8d iterations: %.3f us each (%s...; %g)\n", "digest", count, 1e6 * seconds / count,
              orbitune::ToHex(digest).substr(0, 8).c_str(), sum);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  const std::string path = std::string(argv[1]) + "/benchmark.db";
  const int iterations = argc > 2 ? std::atoi(argv[2]) : 100'000;
  const int jobs = argc > 3 ? std::atoi(argv[3]) : 1;
  auto store = orbitune::OpenSqliteStore({.path = path});
  if (!store.ok()) {
    std::fprintf(stderr, "%s\n", std::string(store.status().message()).c_str());
    return 1;
  }
  for (int j = 0; j < jobs; ++j) {
    if (!Create(**store, "job-" + std::to_string(j)).ok()) return 1;
  }
  Run(**store, jobs, 1, iterations, false, "all at once");
  Run(**store, jobs, iterations + 1, iterations + 2000, true, "one at a time");
  RunDigests(iterations);
  store->reset();
  const auto size = std::filesystem::file_size(path);
  std::printf("%.1f bytes each on disk\n", static_cast<double>(size) / (jobs * (iterations + 2000.0)));
  return 0;
}
