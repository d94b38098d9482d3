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
    if (http != nullptr) http->SetServing(serving);
    std::fprintf(stderr, "orbituned: %s\n",
                 serving ? "the disk is back; jobs go on"
                         : absl::StrCat("jobs wait for the disk: ", std::string(disk.message())).c_str());
  }
}

// A disk that hangs, or an episode of minutes, must not hold a stop up. Ending at once loses nothing that a client was
// told, as a crash would not.
void EndInAnyCase() {
  std::thread([] {
    std::this_thread::sleep_for(std::chrono::milliseconds(4500));
    std::fprintf(stderr, "orbituned: something holds the stop up; ending at once\n");
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

HttpOptions HttpOptionsOf(const ServerConfig& config) {
  HttpOptions options;
  options.address = config.http;
  options.tls = TlsFilesOf(config);
  options.web_dir = config.web_dir;
  options.cors_origins = config.http_cors_origins;
  options.max_connections = config.http_max_connections;
  options.max_header_bytes = static_cast<std::size_t>(config.http_max_header_bytes);
  options.max_body_bytes = static_cast<std::size_t>(config.http_max_body_bytes);
  options.header_time = Milliseconds(config.http_header_time_s);
  options.body_time = Milliseconds(config.http_body_time_s);
  options.idle_time = Milliseconds(config.http_idle_time_s);
  options.stall_time = Milliseconds(config.http_stall_time_s);
  return options;
}

// nullptr where there is to be none.
absl::StatusOr<std::unique_ptr<HttpServer>> StartHttp(const ServerConfig& config, Api& api) {
  if (config.http == "off") return nullptr;
  return HttpServer::Start(HttpOptionsOf(config), api);
}

// Both at once, so that one does not use up the other's time.
void ShutDown(RpcServer& rpc, HttpServer* http) {
  constexpr std::chrono::milliseconds kGrace{2000};
  const std::jthread beside([http] {
    if (http != nullptr) http->Shutdown(kGrace);
  });
  rpc.Shutdown(kGrace);
}

int Serve(const ServerConfig& config) {
  const sigset_t signals = BlockSignals();
  RaiseFileLimit();
  std::error_code error;
  std::filesystem::create_directories(config.data_dir, error);
  if (error) return Fail(absl::UnavailableError("--data-dir " + config.data_dir + ": " + error.message()));
  if (!simd::UseTarget(config.simd)) {
    return Fail(absl::FailedPreconditionError("--simd " + config.simd + ": not an instruction set of this processor"));
  }
  const std::string database = config.data_dir + "/orbitune.db";
  auto access = Access::Open(config.data_dir + "/access.db");
  if (!access.ok()) return Fail(access.status());
  if (absl::Status status = CheckAccess(config, **access); !status.ok()) return Fail(status);
  auto store = OpenSqliteStore({.path = database});
  if (!store.ok()) return Fail(store.status());
  GainLibrary library;
  if (absl::Status status = LoadLibrary((*store)->gains(), library); !status.ok()) return Fail(status);
  EventHub hub;
  Scheduler scheduler(**store, hub,
                      {.threads = config.threads, .max_running_jobs = config.max_running_jobs, .library = &library});
  UseCases use_cases(**store, scheduler, hub);
  GainUseCases gains(**store, library);
  use_cases.set_gain_sets([&gains](const std::string& id) { return gains.WarmStartFrom(id); });
  CampaignEngine campaigns(**store, (*store)->campaigns(), scheduler, hub, &library);
  CampaignUseCases campaign_use_cases(use_cases, (*store)->campaigns(), campaigns);
  absl::Status started = scheduler.Start();
  if (started.ok()) started = campaigns.Start();
  if (!started.ok()) return Fail(started);
  Api api(use_cases, campaign_use_cases, gains, access->get());
  auto rpc = RpcServer::Start(config.listen, api, TlsFilesOf(config));
  if (!rpc.ok()) return Fail(rpc.status());
  auto http = StartHttp(config, api);
  if (!http.ok()) return Fail(http.status());

  std::printf("orbituned " ORBITUNE_VERSION "\ngrpc %s\nhttp %s\ndata %s\nthreads %d, %s\naccess %s\n",
              (*rpc)->address().c_str(), *http == nullptr ? "off" : (*http)->address().c_str(), database.c_str(),
              config.threads, simd::TargetInUse().c_str(), DescribeAccess(config, **access).c_str());
  std::fflush(stdout);

  const int signal = ServeUntilSignal(signals, **store, **access, **rpc, http->get());
  std::printf("%s: stopping; unfinished jobs go on at the next start\n", signal == SIGINT ? "SIGINT" : "SIGTERM");
  std::fflush(stdout);
  EndInAnyCase();
  ShutDown(**rpc, http->get());
  campaigns.Stop();
  scheduler.Stop();
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
