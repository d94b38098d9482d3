// What the tests of the binaries share: processes whose output is kept, and an orbituned that listens.
#pragma once

#include <sys/types.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace orbitune::server_test {

std::string Contents(const std::string& path);
std::vector<std::string> LinesOf(const std::string& text);

// A process whose output goes to files; killed with the object.
class Process {
 public:
  // environment: "NAME=value", beside what the test has, less what of it is Orbitune's. HTTP is on any free port unless
  // that says otherwise.
  Process(const std::string& output_prefix, std::vector<std::string> arguments,
          const std::vector<std::string>& environment = {});
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  pid_t pid() const { return pid_; }
  void Signal(int signal) const;

  // The exit status, or 128 + the signal that ended it.
  int Wait();

  // The exit status, if it has ended by itself.
  std::optional<int> Ended();

  std::string out() const { return Contents(out_); }
  std::string err() const { return Contents(err_); }

  // The most memory that it has had, in MiB.
  double peak_memory_mib() const;

 private:
  const std::string out_;
  const std::string err_;
  pid_t pid_ = 0;
};

// orbituned with these arguments.
std::vector<std::string> ServerCommand(const std::vector<std::string>& arguments);

// An orbituned that listens.
class Server {
 public:
  Server(const std::string& output_prefix, const std::vector<std::string>& arguments,
         const std::vector<std::string>& environment = {});

  const std::string& address() const { return address_; }            // gRPC's
  const std::string& http_address() const { return http_address_; }  // "off": none
  Process& process() { return *process_; }

  void KillHard();
  int Terminate(int signal);
  int Terminate();  // by SIGTERM

 private:
  std::unique_ptr<Process> process_;
  std::string address_;
  std::string http_address_;
};

}  // namespace orbitune::server_test
