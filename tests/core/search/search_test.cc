#include "core/search/search.h"

#include <gtest/gtest.h>

#include <cmath>

namespace orbitune {
namespace {

IterationRecord Record(Outcome outcome, double cost) { return {.iteration = 3, .outcome = outcome, .cost = cost}; }

TEST(BetterTest, SettledFirstThenCost) {
  const auto settled = Record(Outcome::kSettled, 500), cheaper = Record(Outcome::kSettled, 400);
  const auto not_settled = Record(Outcome::kNotSettled, 10), left = Record(Outcome::kLeftDomain, kUnset),
             failed = Record(Outcome::kNumericalFailure, kUnset);
  EXPECT_TRUE(Better(cheaper, settled));
  EXPECT_FALSE(Better(settled, cheaper));
  EXPECT_FALSE(Better(settled, settled)) << "the earlier of equals stays";
  EXPECT_TRUE(Better(settled, not_settled)) << "whatever the cost of one that did not settle";
  EXPECT_FALSE(Better(not_settled, settled));
  EXPECT_TRUE(Better(not_settled, left));
  EXPECT_FALSE(Better(left, failed));
  EXPECT_FALSE(Better(failed, left));
}

TEST(IdenticalTest, ComparesEveryFieldAndItsBits) {
  const IterationRecord record{.iteration = 3,
                               .gains = {1, 2, 3, 4, 5},
                               .outcome = Outcome::kSettled,
                               .cost = 6,
                               .settling_samples = 7,
                               .fuel_sum = 8,
                               .cost_std = 9,
                               .pairs_left_out = 10,
                               .pairs_not_settled = 11};
  EXPECT_TRUE(Identical(record, record));
  const auto differs = [&](auto&& change) {
    IterationRecord other = record;
    change(other);
    return !Identical(record, other) && !Identical(other, record);
  };
  const double next = std::nextafter(6, 7);
  EXPECT_TRUE(differs([](IterationRecord& r) { r.iteration = 4; }));
  EXPECT_TRUE(differs([](IterationRecord& r) { r.gains[4] = std::nextafter(5, 6); }));
  EXPECT_TRUE(differs([](IterationRecord& r) { r.outcome = Outcome::kNotSettled; }));
  EXPECT_TRUE(differs([&](IterationRecord& r) { r.cost = next; }));
  EXPECT_TRUE(differs([](IterationRecord& r) { r.cost = kUnset; }));
  EXPECT_TRUE(differs([](IterationRecord& r) { r.settling_samples = 8; }));
  EXPECT_TRUE(differs([](IterationRecord& r) { r.fuel_sum = 8.5; }));
  EXPECT_TRUE(differs([](IterationRecord& r) { r.cost_std = 9.5; }));
  EXPECT_TRUE(differs([](IterationRecord& r) { r.pairs_left_out = 0; }));
  EXPECT_TRUE(differs([](IterationRecord& r) { r.pairs_not_settled = 0; }));
  EXPECT_TRUE(Identical(IterationRecord{}, IterationRecord{})) << "NaN equals NaN";
}

}  // namespace
}  // namespace orbitune
