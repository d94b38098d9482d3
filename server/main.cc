// orbituned: wiring only.
#include <pthread.h>
#include <signal.h>

#include <chrono>
#include <cstdio>
#include <filesystem>

#include "core/simd/lane_kernel.h"
#include "server/config/config.h"
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
  return signals;
}

int Fail(const absl::Status& status) {
  std::fprintf(stderr, "orbituned: %s\n", std::string(status.message()).c_str());
  return 1;
}

int Serve(const ServerConfig& config) {
  const sigset_t signals = BlockSignals();
  std::error_code error;
  std::filesystem::create_directories(config.data_dir, error);
  if (error) return Fail(absl::UnavailableError("--data-dir " + config.data_dir + ": " + error.message()));
  if (!simd::UseTarget(config.simd)) {
    return Fail(absl::FailedPreconditionError("--simd " + config.simd + ": not an instruction set of this processor"));
  }
  const std::string database = config.data_dir + "/orbitune.db";
  auto store = OpenSqliteStore({.path = database});
  if (!store.ok()) return Fail(store.status());
  EventHub hub;
  Scheduler scheduler(**store, hub, {.threads = config.threads, .max_running_jobs = config.max_running_jobs});
  UseCases use_cases(**store, scheduler, hub);
  if (absl::Status status = scheduler.Start(); !status.ok()) return Fail(status);
  auto server = RpcServer::Start(config.listen, use_cases);
  if (!server.ok()) return Fail(server.status());

  std::printf("orbituned " ORBITUNE_VERSION "\ngrpc %s\ndata %s\nthreads %d, %s\n", (*server)->address().c_str(),
              database.c_str(), config.threads, simd::TargetInUse().c_str());
  std::fflush(stdout);

  int signal = 0;
  sigwait(&signals, &signal);
  std::printf("%s: stopping; unfinished jobs go on at the next start\n", signal == SIGINT ? "SIGINT" : "SIGTERM");
  std::fflush(stdout);
  (*server)->Shutdown(std::chrono::milliseconds(2000));
  scheduler.Stop();
  return 0;
}

}  // namespace
}  // namespace orbitune

int main(int argc, char** argv) {
  int exit_code = 0;
  const auto config = orbitune::ParseServerConfig(argc, argv, exit_code);
  return config ? orbitune::Serve(*config) : exit_code;
}
