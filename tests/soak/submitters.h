// Clients that submit jobs and follow them by unary calls, each on a thread and a connection of its own.
#pragma once

#include <string>
#include <thread>
#include <vector>

#include "tests/soak/journal.h"

namespace orbitune::soak {

class Submitters {
 public:
  // journal: outlives this. pause_s: between two calls of one client.
  Submitters(const std::string& address, int count, double pause_s, Journal& journal);
  ~Submitters() { Stop(); }

  // Waits until all have ended; to be called once journal.stopping is set.
  void Stop();

 private:
  std::vector<std::thread> threads_;
};

// A job that goes on longer than the soak; its name. Ends the soak where the server refuses it.
std::string CreateEndlessJob(const std::string& address, int number);

}  // namespace orbitune::soak
