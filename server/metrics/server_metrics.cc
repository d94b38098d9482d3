#include "server/metrics/server_metrics.h"

#include <sys/resource.h>
#include <sys/time.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "absl/strings/str_cat.h"
#include "core/simd/lane_kernel.h"

namespace orbitune {
namespace {

namespace fs = std::filesystem;

double FileBytes(const std::string& path) {
  std::error_code error;
  const std::uintmax_t bytes = fs::file_size(path, error);
  return error ? 0 : static_cast<double>(bytes);
}

double EntriesOf(const char* directory) {
  std::error_code error;
  const fs::directory_iterator begin(directory, error);
  return error ? 0 : static_cast<double>(std::distance(begin, fs::directory_iterator()));
}

double ResidentBytes() {
  std::ifstream file("/proc/self/statm");
  double size = 0, resident = 0;
  file >> size >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE));
}

double CpuSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

double MostFds() {
  rlimit limit{};
  return getrlimit(RLIMIT_NOFILE, &limit) == 0 ? static_cast<double>(limit.rlim_cur) : 0;
}

double Value(const std::atomic<std::int64_t>& counter) {
  return static_cast<double>(counter.load(std::memory_order_relaxed));
}

void AddJobs(Scheduler& scheduler, MetricsRegistry& registry) {
  const JobMetrics& jobs = scheduler.metrics();
  registry.AddGauge("orbitune_jobs", "Unfinished jobs by state.", [&scheduler] {
    const JobCounts counts = scheduler.counts();
    return std::vector<MetricValue>{{{{"state", "queued"}}, static_cast<double>(counts.queued)},
                                    {{{"state", "running"}}, static_cast<double>(counts.running)},
                                    {{{"state", "paused"}}, static_cast<double>(counts.paused)}};
  });
  registry.AddCounter("orbitune_jobs_ended_total", "Jobs that have ended, by the state they ended in.", [&jobs] {
    std::vector<MetricValue> rows;
    for (const auto& [state, name] :
         {std::pair(JobState::kSucceeded, "succeeded"), std::pair(JobState::kFailed, "failed"),
          std::pair(JobState::kCancelled, "cancelled")}) {
      rows.push_back({{{"state", name}}, Value(jobs.ended[static_cast<std::size_t>(state)])});
    }
    return rows;
  });
  registry.AddCounter("orbitune_iterations_total", "Iterations committed.", [&jobs] { return Value(jobs.iterations); });
  registry.AddCounter("orbitune_episodes_total", "Episodes flown for jobs.", [&jobs] { return Value(jobs.episodes); });
  registry.AddCounter("orbitune_lane_steps_total", "Steps of the vector kernel, counted in every lane.",
                      [&jobs] { return Value(jobs.lane_steps); });
  registry.AddCounter("orbitune_lane_steps_used_total",
                      "Those in lanes that had an episode to fly; over all of them: lane occupancy.",
                      [&jobs] { return Value(jobs.used_lane_steps); });
  registry.AddHistogram("orbitune_queue_wait_seconds", "How long jobs waited to begin.", jobs.queue_wait_s);
}

void AddStore(const MetricsSources& sources, MetricsRegistry& registry) {
  registry.AddHistogram("orbitune_store_commit_seconds", "How long a commit took until it was on disk.",
                        sources.store_metrics.commit_s);
  registry.AddHistogram("orbitune_store_commit_operations", "Writes that one commit took together.",
                        sources.store_metrics.group_size);
  registry.AddGauge("orbitune_database_bytes", "Size of the database and of its write-ahead log.",
                    [database = sources.database] {
                      return std::vector<MetricValue>{{{{"file", "database"}}, FileBytes(database)},
                                                      {{{"file", "wal"}}, FileBytes(database + "-wal")}};
                    });
  registry.AddGauge("orbitune_disk_ok", "1 while the store can write, 0 while jobs wait for the disk.",
                    [&store = sources.store] { return store.ok_for_now().ok() ? 1.0 : 0.0; });
}

void AddApi(Api& api, MetricsRegistry& registry) {
  registry.AddGauge("orbitune_watchers", "Open streams by transport.", [&api] {
    const Feeds::Counts counts = api.CountWatchers();
    std::vector<MetricValue> rows;
    for (const std::string_view transport : {"grpc", "sse", "ndjson"}) {
      const auto found = counts.by_transport.find(transport);
      rows.push_back({{{"transport", std::string(transport)}},
                      found == counts.by_transport.end() ? 0.0 : static_cast<double>(found->second)});
    }
    return rows;
  });
  registry.AddGauge("orbitune_watcher_lag_events", "Events that the watcher furthest behind has yet to take.",
                    [&api] { return static_cast<double>(api.CountWatchers().largest_lag); });
  registry.AddGauge("orbitune_watchers_behind", "Watchers so far behind that they are fed from the database.",
                    [&api] { return static_cast<double>(api.CountWatchers().behind); });
  registry.AddHistogram(
      "orbitune_call_seconds", "How long calls took, waiting included, by method and status.", [&api] {
        std::vector<MetricHistogram> rows;
        for (CallMetrics::Row& row : api.call_metrics().Read()) {
          rows.push_back({{{"method", absl::StrCat(row.method->service()->name(), ".", row.method->name())},
                           {"code", absl::StatusCodeToString(row.code)}},
                          std::move(row.seconds)});
        }
        return rows;
      });
  registry.AddGauge("orbitune_calls_waiting", "Calls that wait for a thread, by what they keep busy.", [&api] {
    std::vector<MetricValue> rows;
    for (const auto& [work, name] :
         {std::pair(Work::kRead, "read"), std::pair(Work::kWrite, "write"), std::pair(Work::kQuery, "query"),
          std::pair(Work::kEpisode, "episode"), std::pair(Work::kStream, "stream"), std::pair(Work::kCrowd, "crowd"),
          std::pair(Work::kVerify, "verify")}) {
      rows.push_back({{{"work", name}}, static_cast<double>(api.executors().For(work).waiting())});
    }
    return rows;
  });
}

// By the names that every Prometheus client library gives them.
void AddProcess(MetricsRegistry& registry) {
  registry.AddGauge("process_resident_memory_bytes", "Resident memory.", ResidentBytes);
  registry.AddGauge("process_open_fds", "Open file descriptors.", [] { return EntriesOf("/proc/self/fd"); });
  registry.AddGauge("process_max_fds", "The most that there may be.", MostFds);
  registry.AddGauge("process_threads", "Threads.", [] { return EntriesOf("/proc/self/task"); });
  registry.AddCounter("process_cpu_seconds_total", "User and system time.", CpuSeconds);
  const double now = static_cast<double>(NowUs()) * 1e-6;
  registry.AddGauge("process_start_time_seconds", "When the server started, since the Unix epoch.",
                    [now] { return now; });
}

}  // namespace

void AddServerMetrics(const MetricsSources& sources, MetricsRegistry& registry) {
  registry.AddGauge("orbitune_build_info", "1; what runs.", [version = sources.version] {
    return std::vector<MetricValue>{{{{"version", version}, {"simd", simd::TargetInUse()}}, 1}};
  });
  AddJobs(sources.scheduler, registry);
  AddStore(sources, registry);
  AddApi(sources.api, registry);
  AddProcess(registry);
}

}  // namespace orbitune
