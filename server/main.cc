// orbituned: wiring only.
#include <pthread.h>
#include <signal.h>
#include <sys/resource.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <thread>

#include "absl/strings/str_cat.h"
#include "core/simd/lane_kernel.h"
#include "server/commands/commands.h"
#include "server/config/config.h"
#include "server/config/exposure.h"
#include "server/jobs/gain_sets.h"
#include "server/jobs/retention.h"
#include "server/log/log.h"
#include "server/metrics/server_metrics.h"
#include "server/rest/server.h"
#include "server/rpc/server.h"
#include "storage/sqlite_store.h"

namespace orbitune {
namespace {

// Blocks the signals that end the server in every thread started after this; returns them.
sigset_t BlockSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  // A file at its size limit is a full disk, not an end; nor is a peer that has gone.
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
  return signals;
}

// A connection each: as many files as the system lets us open.
void RaiseFileLimit() {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
}

int Fail(const absl::Status& status) {
  std::fprintf(stderr, "orbituned: %s\n", std::string(status.message()).c_str());
  return 1;
}

// Until a signal comes, health follows the disk.
int ServeUntilSignal(const sigset_t& signals, const JobStore& store, const Access& access, RpcServer& rpc,
                     HttpServer* http) {
  bool serving = true;
  while (true) {
    constexpr timespec kPeriod{.tv_sec = 1, .tv_nsec = 0};
    const int signal = sigtimedwait(&signals, nullptr, &kPeriod);
    if (signal > 0) return signal;
    absl::Status disk = store.ok_for_now();
    if (disk.ok()) disk = access.AuditReady();
    if (disk.ok() == serving) continue;
    serving = disk.ok();
    rpc.SetServing(serving);
    if (http != nullptr) http->SetServing(disk);
    if (serving) {
      Log(LogLevel::kInfo, "the disk is back; jobs go on");
    } else {
      Log(LogLevel::kError, "jobs wait for the disk", {{"error", std::string(disk.message())}});
    }
  }
}

// A disk that hangs, or an episode of minutes, must not hold a stop up. Ending at once loses nothing that a client was
// told, as a crash would not.
void EndInAnyCase() {
  std::thread([] {
    std::this_thread::sleep_for(std::chrono::milliseconds(4500));
    Log(LogLevel::kError, "something holds the stop up; ending at once");
    std::_Exit(0);
  }).detach();
}

std::chrono::milliseconds Milliseconds(double seconds) {
  return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::duration<double>(seconds));
}

TlsFiles TlsFilesOf(const ServerConfig& config) {
  return {.certificate = config.tls_cert, .key = config.tls_key, .client_ca = config.tls_client_ca};
}

// Whether the files can be used, and whether what listens to others than this machine asks who they are.
absl::Status CheckAccess(const ServerConfig& config, const Access& access) {
  const TlsFiles tls = TlsFilesOf(config);
  if (tls.on()) {
    if (absl::Status status = TlsContext::Load(tls).status(); !status.ok()) return status;
  }
  return CheckExposure(config, access.needs_token());
}

std::string DescribeAccess(const ServerConfig& config, const Access& access) {
  const char* const tls = config.tls_cert.empty()        ? "in the clear"
                          : config.tls_client_ca.empty() ? "TLS"
                                                         : "TLS with clients' certificates";
  return absl::StrCat(access.needs_token() ? "by token" : "everybody is an admin, for there are no tokens", ", ", tls);
}

HttpOptions HttpOptionsOf(const ServerConfig& config, std::function<std::string()> metrics) {
  HttpOptions options;
  options.address = config.http;
  options.tls = TlsFilesOf(config);
  options.web_dir = config.web_dir;
  options.cors_origins = config.http_cors_origins;
  options.max_connections = config.http_max_connections;
  options.max_connections_per_client = config.http_max_connections_per_client;
  options.max_header_bytes = static_cast<std::size_t>(config.http_max_header_bytes);
  options.max_body_bytes = static_cast<std::size_t>(config.http_max_body_bytes);
  options.max_bodies_bytes = static_cast<std::size_t>(config.http_max_bodies_bytes);
  options.header_time = Milliseconds(config.http_header_time_s);
  options.body_time = Milliseconds(config.http_body_time_s);
  options.idle_time = Milliseconds(config.http_idle_time_s);
  options.stall_time = Milliseconds(config.http_stall_time_s);
  options.metrics = std::move(metrics);
  return options;
}

// nullptr where there is to be none.
absl::StatusOr<std::unique_ptr<HttpServer>> StartHttp(const ServerConfig& config, Api& api,
                                                      std::function<std::string()> metrics) {
  if (config.http == "off") return nullptr;
  return HttpServer::Start(HttpOptionsOf(config, std::move(metrics)), api);
}

Scheduler::Options SchedulerOptionsOf(const ServerConfig& config, GainLibrary& library) {
  return {.threads = config.threads,
          .max_running_jobs = config.max_running_jobs,
          .limits = {.max_queued_jobs = config.max_queued_jobs,
                     .max_jobs_per_client = config.max_jobs_per_client,
                     .max_job_memory_bytes = std::int64_t{config.max_job_memory_mib} << 20},
          .library = &library};
}

ApiLimits ApiLimitsOf(const ServerConfig& config) {
  return {.calls = {.max_calls_waiting = config.max_calls_waiting,
                    .max_calls_waiting_per_client = config.max_calls_waiting_per_client,
                    .max_episode_calls = config.max_episode_calls,
                    .max_verifications = config.max_verifications},
          .watchers = {.max_watchers = config.max_watchers, .max_watchers_per_client = config.max_watchers_per_client},
          .max_waiting_bytes = std::int64_t{config.max_waiting_mib} << 20,
          .max_response_bytes = config.max_response_bytes,
          .slow_call_s = config.log_slow_call_s};
}

RpcServer::Limits RpcLimitsOf(const ServerConfig& config) {
  return {.max_request_bytes = config.max_request_bytes,
          .max_streams_per_connection = config.max_streams_per_connection,
          .memory_bytes = std::int64_t{config.grpc_memory_mib} << 20};
}

// Both at once, so that one does not use up the other's time.
void ShutDown(RpcServer& rpc, HttpServer* http) {
  constexpr std::chrono::milliseconds kGrace{2000};
  const std::jthread beside([http] {
    if (http != nullptr) http->Shutdown(kGrace);
  });
  rpc.Shutdown(kGrace);
}

void LogLine(const std::string& text) { Log(LogLevel::kWarning, text); }

SqliteStoreOptions StoreOptionsOf(const ServerConfig& config, const std::string& database, StoreMetrics& metrics) {
  using StartCheck = SqliteStoreOptions::StartCheck;
  return {.path = database,
          .metrics = &metrics,
          .start_check = config.start_check == "full"  ? StartCheck::kFull
                         : config.start_check == "off" ? StartCheck::kNone
                                                       : StartCheck::kAfterCrash,
          .log = LogLine};
}

RetentionPolicy RetentionOf(const ServerConfig& config) {
  return {.jobs_days = config.retain_jobs_days,
          .campaigns_days = config.retain_campaigns_days,
          .iterations_days = config.retain_iterations_days,
          .backups_days = config.retain_backups_days,
          .max_database_bytes = static_cast<std::int64_t>(config.max_database_bytes)};
}

int Serve(const ServerConfig& config) {
  SetUpLog({.level = *LogLevelFrom(config.log_level), .json = config.log_format == "json", .sink = {}});
  const sigset_t signals = BlockSignals();
  RaiseFileLimit();
  std::error_code error;
  std::filesystem::create_directories(config.data_dir, error);
  if (error) return Fail(absl::UnavailableError("--data-dir " + config.data_dir + ": " + error.message()));
  if (!simd::UseTarget(config.simd)) {
    return Fail(absl::FailedPreconditionError("--simd " + config.simd + ": not an instruction set of this processor"));
  }
  StoreMetrics store_metrics;
  const std::string database = config.data_dir + "/orbitune.db";
  auto access = Access::Open(config.data_dir + "/access.db", {.retain_audit_days = config.retain_audit_days});
  if (!access.ok()) return Fail(access.status());
  if (absl::Status status = CheckAccess(config, **access); !status.ok()) return Fail(status);
  auto store = OpenSqliteStore(StoreOptionsOf(config, database, store_metrics));
  if (!store.ok()) return Fail(store.status());
  GainLibrary library;
  if (absl::Status status = LoadLibrary((*store)->gains(), library); !status.ok()) return Fail(status);
  EventHub hub;
  Scheduler scheduler(**store, hub, SchedulerOptionsOf(config, library));
  UseCases use_cases(**store, scheduler, hub);
  GainUseCases gains(**store, library);
  use_cases.set_gain_sets([&gains](const std::string& id) { return gains.WarmStartFrom(id); });
  CampaignEngine campaigns(**store, (*store)->campaigns(), scheduler, hub, &library, config.max_campaigns_per_client);
  CampaignUseCases campaign_use_cases(use_cases, (*store)->campaigns(), campaigns);
  absl::Status started = scheduler.Start();
  if (started.ok()) started = campaigns.Start();
  if (!started.ok()) return Fail(started);
  Api api(use_cases, campaign_use_cases, gains, access->get(), ApiLimitsOf(config));
  auto rpc = RpcServer::Start(config.listen, api, TlsFilesOf(config), RpcLimitsOf(config));
  if (!rpc.ok()) return Fail(rpc.status());
  MetricsRegistry metrics;
  AddServerMetrics({**store, store_metrics, scheduler, api, database, ORBITUNE_VERSION}, metrics);
  auto http = StartHttp(config, api, [&metrics] { return metrics.Text(); });
  if (!http.ok()) return Fail(http.status());

  std::printf("orbituned " ORBITUNE_VERSION "\ngrpc %s\nhttp %s\ndata %s\nthreads %d, %s\naccess %s\n",
              (*rpc)->address().c_str(), *http == nullptr ? "off" : (*http)->address().c_str(), database.c_str(),
              config.threads, simd::TargetInUse().c_str(), DescribeAccess(config, **access).c_str());
  std::fflush(stdout);

  Retention retention(**store, campaigns, database, RetentionOf(config), LogLine);
  retention.Start();
  const JobCounts jobs = scheduler.counts();
  Log(LogLevel::kInfo, "started",
      {{"version", ORBITUNE_VERSION},
       {"grpc", (*rpc)->address()},
       {"http", *http == nullptr ? "off" : (*http)->address()},
       {"data", config.data_dir},
       {"threads", config.threads},
       {"simd", simd::TargetInUse()},
       {"access", DescribeAccess(config, **access)},
       {"max_running_jobs", config.max_running_jobs},
       {"unfinished_jobs", jobs.queued + jobs.running + jobs.paused}});
  const int signal = ServeUntilSignal(signals, **store, **access, **rpc, http->get());
  std::printf("%s: stopping; unfinished jobs go on at the next start\n", signal == SIGINT ? "SIGINT" : "SIGTERM");
  std::fflush(stdout);
  Log(LogLevel::kInfo, "stopping", {{"signal", signal == SIGINT ? "SIGINT" : "SIGTERM"}});
  EndInAnyCase();
  retention.Stop();
  ShutDown(**rpc, http->get());
  campaigns.Stop();
  scheduler.Stop();
  Log(LogLevel::kInfo, "stopped");
  return 0;
}

}  // namespace
}  // namespace orbitune

int main(int argc, char** argv) {
  if (const orbitune::Command* command = argc > 1 ? orbitune::FindCommand(argv[1]) : nullptr) {
    return command->run(argc - 1, argv + 1);
  }
  int exit_code = 0;
  const auto config = orbitune::ParseServerConfig(argc, argv, orbitune::CommandsHelp(), exit_code);
  return config ? orbitune::Serve(*config) : exit_code;
}
