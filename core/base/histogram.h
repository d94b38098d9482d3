// Counts of values by size, for metrics: written from any thread at the cost of three atomic additions.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace orbitune {

// Thread-safe.
class Histogram {
 public:
  struct Snapshot {
    std::vector<double> bounds;         // upper ones, ascending; the last bucket has none
    std::vector<std::uint64_t> counts;  // of each bucket: one more than bounds
    double sum = 0;
  };

  // bounds: ascending.
  explicit Histogram(std::vector<double> bounds);

  // `factor` times as large each, `count` of them.
  static std::vector<double> Exponential(double first, double factor, std::size_t count);

  void Observe(double value);

  // A value that is being observed may be in the counts and not yet in the sum.
  Snapshot Read() const;

 private:
  const std::vector<double> bounds_;
  std::vector<std::atomic<std::uint64_t>> counts_;
  std::atomic<double> sum_ = 0;
};

}  // namespace orbitune
