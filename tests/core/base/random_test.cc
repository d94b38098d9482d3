#include "core/base/random.h"

#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

namespace orbitune {
namespace {

// The 64 bits that a uniform draw must have been made of, to the 53 it keeps.
double UniformOf(std::uint64_t bits) { return (static_cast<double>(bits >> 11) + 0.5) * 0x1p-53; }

// Known answers of Philox4x32-10, from the Random123 distribution's kat_vectors.
TEST(RandomTest, UniformIsPhiloxsKnownAnswer) {
  const RandomKey zeros{.seed = 0, .stream = RandomStream{0}, .a = 0, .b = 0};
  EXPECT_EQ(StandardUniform(zeros, 0), UniformOf(0x6627e8d5'e169c58d));

  const RandomKey ones{
      .seed = 0xffffffff'ffffffff, .stream = RandomStream{0xffffffff}, .a = 0xffffffff, .b = 0xffffffff};
  EXPECT_EQ(StandardUniform(ones, 0xffffffff), UniformOf(0x408f276d'41c83b0e));

  const RandomKey digits_of_pi{
      .seed = 0x299f31d0'a4093822, .stream = RandomStream{0x03707344}, .a = 0x13198a2e, .b = 0x85a308d3};
  EXPECT_EQ(StandardUniform(digits_of_pi, 0x243f6a88), UniformOf(0xd16cfe09'94fdcceb));
}

// Box-Muller over the same vector: the first two words give the radius, the last two the angle. Not to the last bit:
// the C library's log and cos may differ there between processors.
TEST(RandomTest, NormalIsBoxMullerOfOneBlock) {
  const RandomKey zeros{.seed = 0, .stream = RandomStream{0}, .a = 0, .b = 0};
  const double radius = std::sqrt(-2 * std::log(UniformOf(0x6627e8d5'e169c58d)));
  const double angle = 2 * std::numbers::pi * UniformOf(0xbc57ac4c'9b00dbd8);
  EXPECT_DOUBLE_EQ(StandardNormal(zeros, 0), radius * std::cos(angle));
  EXPECT_DOUBLE_EQ(StandardNormal(zeros, 1), radius * std::sin(angle));
}

// A job resumed by a later version must see the numbers it began with.
TEST(RandomTest, ValuesNeverChange) {
  const RandomKey directions{.seed = 1, .stream = RandomStream::kSearchDirections, .a = 1, .b = 0};
  EXPECT_EQ(std::bit_cast<std::uint64_t>(StandardUniform(directions, 0)), 0x3fd7ce1695d95f11u);
  EXPECT_DOUBLE_EQ(StandardNormal(directions, 0), -1.3109387081789932);
  EXPECT_DOUBLE_EQ(StandardNormal(directions, 4), -1.2902082723105674);
  const RandomKey conditions{.seed = 20240229, .stream = RandomStream::kInitialConditions, .a = 7, .b = 3};
  EXPECT_EQ(std::bit_cast<std::uint64_t>(StandardUniform(conditions, 2)), 0x3fd088b8d8fc0635u);
  EXPECT_DOUBLE_EQ(StandardNormal(conditions, 5), 1.4497969254412229);
}

TEST(RandomTest, EveryCoordinateCounts) {
  const RandomKey base{.seed = 5, .stream = RandomStream::kSearchDirections, .a = 10, .b = 20};
  RandomKey high_seed = base, stream = base, a = base, b = base;
  high_seed.seed += std::uint64_t{1} << 32;
  stream.stream = RandomStream::kInitialConditions;
  a.a += 1;
  b.b += 1;
  for (const RandomKey& other : {high_seed, stream, a, b}) {
    EXPECT_NE(StandardUniform(base, 0), StandardUniform(other, 0));
    EXPECT_NE(StandardNormal(base, 0), StandardNormal(other, 0));
  }
  EXPECT_NE(StandardUniform(base, 0), StandardUniform(base, 1));
}

TEST(RandomTest, UniformFillsTheUnitIntervalAboveZero) {
  constexpr int kDraws = 200'000;
  std::array<int, 16> bins{};
  double sum = 0;
  for (std::uint32_t i = 0; i < kDraws; ++i) {
    const double u = StandardUniform({.seed = 3, .a = i / 100, .b = i % 100}, 0);
    ASSERT_GT(u, 0);
    ASSERT_LT(u, 1);  // 1 itself comes once in 2^53
    sum += u;
    ++bins[static_cast<std::size_t>(u * 16)];
  }
  EXPECT_NEAR(sum / kDraws, 0.5, 4 / std::sqrt(12.0 * kDraws));
  for (const int count : bins) EXPECT_NEAR(count, kDraws / 16, 5 * std::sqrt(kDraws / 16.0));
}

// normal[iteration][direction][component] as a search draws them.
class NormalSample {
 public:
  static constexpr std::uint32_t kIterations = 500, kDirections = 32, kComponents = 5;
  static constexpr double kCount = kIterations * kDirections * kComponents;

  NormalSample() {
    for (std::uint32_t a = 0; a < kIterations; ++a) {
      for (std::uint32_t b = 0; b < kDirections; ++b) {
        for (std::uint32_t c = 0; c < kComponents; ++c)
          values_.push_back(StandardNormal({.seed = 9, .a = a, .b = b}, c));
      }
    }
  }

  double Moment(int n) const {
    double sum = 0;
    for (const double v : values_) sum += std::pow(v, n);
    return sum / kCount;
  }

  // Mean product of values `distance` apart.
  double Correlation(std::size_t distance) const {
    double sum = 0;
    for (std::size_t i = distance; i < values_.size(); ++i) sum += values_[i] * values_[i - distance];
    return sum / static_cast<double>(values_.size() - distance);
  }

 private:
  std::vector<double> values_;
};

TEST(RandomTest, NormalHasTheMomentsOfAStandardNormal) {
  const NormalSample sample;
  // Five standard errors each; the variance of z^n is E z^2n - (E z^n)^2.
  const double unit = 5 / std::sqrt(NormalSample::kCount);
  EXPECT_NEAR(sample.Moment(1), 0, unit);
  EXPECT_NEAR(sample.Moment(2), 1, unit * std::sqrt(2.0));
  EXPECT_NEAR(sample.Moment(3), 0, unit * std::sqrt(15.0));
  EXPECT_NEAR(sample.Moment(4), 3, unit * std::sqrt(96.0));
}

TEST(RandomTest, NeighboursAreUncorrelated) {
  const NormalSample sample;
  const double bound = 5 / std::sqrt(NormalSample::kCount);
  EXPECT_NEAR(sample.Correlation(1), 0, bound) << "between components";
  EXPECT_NEAR(sample.Correlation(NormalSample::kComponents), 0, bound) << "between directions";
  EXPECT_NEAR(sample.Correlation(NormalSample::kComponents * NormalSample::kDirections), 0, bound)
      << "between iterations";
}

}  // namespace
}  // namespace orbitune
