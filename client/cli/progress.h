// Where a watched job stands, as one line: fitted to a terminal, or plain for a file.
#pragma once

#include <deque>
#include <optional>
#include <string>

#include "orbitune/v1/tuning.pb.h"

namespace orbitune::cli {

// Iterations per second over the last seconds.
class RateMeter {
 public:
  // `now_s`: of any steady clock. A smaller iteration than before starts over.
  void Add(double now_s, int iteration);

  // Nothing until two iterations a while apart are known.
  std::optional<double> PerSecond() const;

 private:
  struct Sample {
    double time_s;
    int iteration;
  };
  std::deque<Sample> samples_;
};

// The live line: a bar, i/M, J and how it differs from J(K(1)), K, iterations/s, time left. At most `width` columns;
// on a narrow terminal K goes first, from its end, then the speed, the bar, and the time left.
std::string ProgressLine(const v1::Job& job, std::optional<double> iterations_per_s, int width);

// "iteration 12/2000  J 640.123  reduction 21.2 %  K 0.1 1 1 1 10". The total and J(K(1)) are taken from `job`.
std::string IterationLine(const v1::Iteration& iteration, const v1::Job& job);

}  // namespace orbitune::cli
