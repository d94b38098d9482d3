// Whole tuning jobs, timed: through the server with everything stored and streamed, and by the job engine alone.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace orbitune::bench {

inline constexpr int kIterationsPerMessage = 256;  // as the CLI asks for

struct JobRow {
  std::string what;  // "server", "engine"
  int jobs = 0;
  int threads = 0;
  int iterations = 0;  // of each job
  double seconds = 0;
  double iterations_per_s = 0;
  double worst_reduction_percent = 0;   // of the jobs' costs: the work was really done
  int iterations_per_message = 0;       // at most, of "server"
  std::optional<double> added_percent;  // of "server": what storing and streaming add to the engine's seconds
};

// `jobs` gto-geo jobs of other seeds at once, on a database in a temporary folder, each watched over gRPC (EVERY) until
// it ended. Checks that every iteration came once, and in order. There has been a job of one iteration before: what a
// connection, a server's first calls and a thread's first steps cost is not counted.
JobRow RunThroughServer(int jobs, int threads, int iterations, int iterations_per_message);

// The same jobs by the scheduler alone, after one as well: nothing stored, nobody watching.
JobRow RunByEngine(int jobs, int threads, int iterations);

// One job by the engine and through the server, with iterations together in messages as the CLI asks for them and each
// in its own, in turn, `repeats` times: rows of the medians, of seconds and of the paired runs' ratios.
std::vector<JobRow> CompareServerWithEngine(int threads, int iterations, int repeats);

}  // namespace orbitune::bench
