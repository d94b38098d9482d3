#include "tests/server/process_support.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <sstream>
#include <thread>

extern char** environ;

namespace orbitune::server_test {
namespace {

std::vector<char*> Pointers(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (std::string& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

int ExitStatus(int status) { return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status); }

}  // namespace

std::string Contents(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

std::vector<std::string> LinesOf(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

Process::Process(const std::string& output_prefix, std::vector<std::string> arguments,
                 const std::vector<std::string>& environment)
    : out_(output_prefix + ".out"), err_(output_prefix + ".err") {
  std::vector<std::string> variables = environment;
  for (char** variable = environ; *variable != nullptr; ++variable) {
    if (!std::string(*variable).starts_with("ORBITUNE_")) variables.emplace_back(*variable);
  }
  variables.emplace_back("ORBITUNE_HTTP=127.0.0.1:0");  // the first of a name counts
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 1, out_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_addopen(&actions, 2, err_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  const int error = posix_spawn(&pid_, arguments[0].c_str(), &actions, nullptr, Pointers(arguments).data(),
                                Pointers(variables).data());
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) {
    ADD_FAILURE() << "cannot start " << arguments[0];
    pid_ = 0;
  }
}

Process::~Process() {
  if (pid_ == 0) return;
  Signal(SIGKILL);
  Wait();
}

void Process::Signal(int signal) const { kill(pid_, signal); }

int Process::Wait() {
  int status = 0;
  waitpid(pid_, &status, 0);
  pid_ = 0;
  return ExitStatus(status);
}

std::optional<int> Process::Ended() {
  int status = 0;
  if (pid_ == 0 || waitpid(pid_, &status, WNOHANG) != pid_) return std::nullopt;
  pid_ = 0;
  return ExitStatus(status);
}

double Process::peak_memory_mib() const {
  for (const std::string& line : LinesOf(Contents("/proc/" + std::to_string(pid_) + "/status"))) {
    if (line.starts_with("VmHWM:")) return std::stod(line.substr(6)) / 1024;
  }
  ADD_FAILURE() << "no memory told of process " << pid_;
  return 0;
}

std::vector<std::string> ServerCommand(const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {ORBITUNED};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return command;
}

Server::Server(const std::string& output_prefix, const std::vector<std::string>& arguments,
               const std::vector<std::string>& environment)
    : process_(std::make_unique<Process>(output_prefix, ServerCommand(arguments), environment)) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (address_.empty() && !process_->Ended() && std::chrono::steady_clock::now() < deadline) {
    const std::vector<std::string> lines = LinesOf(process_->out());
    // The last line is there once all are.
    if (lines.size() >= 5) {
      address_ = lines[1].substr(std::string("grpc ").size());
      http_address_ = lines[2].substr(std::string("http ").size());
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  EXPECT_NE(address_, "") << process_->err();
}

void Server::KillHard() {
  process_->Signal(SIGKILL);
  EXPECT_EQ(process_->Wait(), 128 + SIGKILL);
}

int Server::Terminate(int signal) {
  process_->Signal(signal);
  return process_->Wait();
}

int Server::Terminate() { return Terminate(SIGTERM); }

}  // namespace orbitune::server_test
