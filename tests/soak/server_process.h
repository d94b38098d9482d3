// The server as a process of its own, and what it has of memory, descriptors and threads.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace orbitune::soak {

struct Usage {
  double resident_mib = 0;
  int descriptors = 0;
  int threads = 0;
};

class ServerProcess {
 public:
  // Starts orbituned over `directory`, with these arguments beside it, and waits until it listens. Ends the soak where
  // it does not.
  ServerProcess(std::string directory, std::vector<std::string> arguments);
  ~ServerProcess();  // kills it
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  const std::string& grpc_address() const { return grpc_; }
  const std::string& http_address() const { return http_; }

  Usage Now() const;

  // By SIGTERM; how long it took, in seconds.
  double Stop();
  // Again, at the same addresses.
  void Start();

 private:
  const std::string directory_;
  const std::vector<std::string> arguments_;
  std::string grpc_ = "127.0.0.1:0";
  std::string http_ = "127.0.0.1:0";
  pid_t pid_ = 0;
};

}  // namespace orbitune::soak
