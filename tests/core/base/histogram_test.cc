#include "core/base/histogram.h"

#include <gtest/gtest.h>

#include <thread>

namespace orbitune {
namespace {

TEST(Histogram, CountsAValueInTheFirstBucketThatHoldsIt) {
  Histogram histogram({1, 10});
  for (const double value : {0.5, 1.0, 1.5, 10.0, 11.0, 1e9}) histogram.Observe(value);
  const Histogram::Snapshot read = histogram.Read();
  EXPECT_EQ(read.bounds, (std::vector<double>{1, 10}));
  EXPECT_EQ(read.counts, (std::vector<std::uint64_t>{2, 2, 2}));
  EXPECT_EQ(read.sum, 0.5 + 1 + 1.5 + 10 + 11 + 1e9);
}

TEST(Histogram, MakesExponentialBounds) {
  EXPECT_EQ(Histogram::Exponential(0.25, 2, 4), (std::vector<double>{0.25, 0.5, 1, 2}));
}

TEST(Histogram, LosesNothingBetweenThreads) {
  Histogram histogram({1});
  const auto observe = [&histogram] {
    for (int i = 0; i < 1000; ++i) histogram.Observe(i % 2 == 0 ? 1 : 2);
  };
  std::thread other(observe);
  observe();
  other.join();
  EXPECT_EQ(histogram.Read().counts, (std::vector<std::uint64_t>{1000, 1000}));
  EXPECT_EQ(histogram.Read().sum, 3000);
}

}  // namespace
}  // namespace orbitune
