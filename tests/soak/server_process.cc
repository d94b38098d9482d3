#include "tests/soak/server_process.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>

extern char** environ;

namespace orbitune::soak {
namespace {

int EntriesOf(const std::string& directory) {
  std::error_code error;
  const std::filesystem::directory_iterator begin(directory, error);
  return error ? 0 : static_cast<int>(std::distance(begin, std::filesystem::directory_iterator()));
}

}  // namespace

ServerProcess::ServerProcess(std::string directory, std::vector<std::string> arguments)
    : directory_(std::move(directory)), arguments_(std::move(arguments)) {
  Start();
}

ServerProcess::~ServerProcess() {
  if (pid_ == 0) return;
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

void ServerProcess::Start() {
  std::vector<std::string> command = {ORBITUNED, "--data-dir", directory_ + "/data", "--listen", grpc_,
                                      "--http",  http_};
  command.insert(command.end(), arguments_.begin(), arguments_.end());
  std::vector<char*> argv;
  for (std::string& text : command) argv.push_back(text.data());
  argv.push_back(nullptr);
  const std::string out = directory_ + "/out";
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 1, out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_addopen(&actions, 2, (directory_ + "/log").c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
  if (posix_spawn(&pid_, command[0].c_str(), &actions, nullptr, argv.data(), environ) != 0) pid_ = 0;
  posix_spawn_file_actions_destroy(&actions);
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(2);
  while (std::chrono::steady_clock::now() < deadline) {
    std::ifstream file(out);
    std::string line, grpc, http;
    while (std::getline(file, line)) {
      if (line.starts_with("grpc ")) grpc = line.substr(5);
      if (line.starts_with("http ")) http = line.substr(5);
    }
    if (!grpc.empty() && !http.empty()) {
      grpc_ = grpc;
      http_ = http;
      return;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  std::fprintf(stderr, "orbitune_soak: the server does not listen; see %s/log\n", directory_.c_str());
  std::_Exit(1);
}

double ServerProcess::Stop() {
  const auto begun = std::chrono::steady_clock::now();
  kill(pid_, SIGTERM);
  waitpid(pid_, nullptr, 0);
  pid_ = 0;
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
}

Usage ServerProcess::Now() const {
  const std::string process = "/proc/" + std::to_string(pid_);
  double size = 0, resident = 0;
  std::ifstream(process + "/statm") >> size >> resident;
  return {.resident_mib = resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20),
          .descriptors = EntriesOf(process + "/fd"),
          .threads = EntriesOf(process + "/task")};
}

}  // namespace orbitune::soak
