#include "core/library/gain_library.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <thread>

#include "absl/strings/str_cat.h"
#include "core/scenario/presets.h"
#include "tests/core/testing.h"

namespace orbitune {
namespace {

using ::testing::ElementsAre;
using testing::Random;

constexpr double kSettlingDistance = 1e-4;

// A start of a random rendezvous.
ErrorState Start(Random& random) {
  return {random.Normal() * 1e-2, random.Normal() * 1e-3, random.Normal() * 1e-3,
          random.Normal() * 1e-4, random.Normal() * 2e-3, random.Normal() * 2e-3};
}

LibraryEntry Entry(const std::string& id, const ErrorState& start, double gain = 1) {
  return {.id = id, .kind = GainSetKind::kTuned, .gains = {gain, gain, gain, gain, gain}, .initial_error = start};
}

LibraryEntry General(const std::string& id) { return {.id = id, .kind = GainSetKind::kMean, .gains = {1, 1, 1, 1, 1}}; }

std::vector<std::string> IdsOf(const std::vector<ScenarioLibrary::Neighbour>& nearest) {
  std::vector<std::string> ids;
  for (const auto& [entry, distance] : nearest) ids.push_back(entry.id);
  return ids;
}

std::array<double, 6> Coordinates(const ErrorState& x) { return {x.x1, x.x2, x.x3, x.x4, x.x5, x.x6}; }

// The nearest ones, found one by one, with the spread that the library is said to use.
std::vector<std::string> BruteForce(const std::vector<LibraryEntry>& entries, const ErrorState& x, std::size_t count) {
  std::array<double, 6> mean{}, variance{};
  const double n = static_cast<double>(entries.size());
  for (const LibraryEntry& e : entries) {
    for (std::size_t i = 0; i < 6; ++i) mean[i] += Coordinates(*e.initial_error)[i] / n;
  }
  for (const LibraryEntry& e : entries) {
    for (std::size_t i = 0; i < 6; ++i) variance[i] += std::pow(Coordinates(*e.initial_error)[i] - mean[i], 2) / n;
  }
  std::vector<std::pair<double, std::string>> all;
  for (const LibraryEntry& e : entries) {
    double squared = 0;
    for (std::size_t i = 0; i < 6; ++i) {
      const double spread = std::max(std::sqrt(variance[i]), kSettlingDistance);
      squared += std::pow((Coordinates(*e.initial_error)[i] - Coordinates(x)[i]) / spread, 2);
    }
    all.emplace_back(squared, e.id);
  }
  std::ranges::sort(all);
  std::vector<std::string> ids;
  for (std::size_t i = 0; i < std::min(count, all.size()); ++i) ids.push_back(all[i].second);
  return ids;
}

TEST(ScenarioLibrary, FindsTheNearestAsASearchOneByOneDoes) {
  Random random(1);
  for (const int size : {1, 2, 10, 200, 3000}) {
    std::vector<LibraryEntry> entries;
    for (int i = 0; i < size; ++i) entries.push_back(Entry(absl::StrCat(i), Start(random)));
    ScenarioLibrary library(kSettlingDistance);
    library.Add(entries);
    for (int query = 0; query < 50; ++query) {
      const ErrorState x = Start(random);
      EXPECT_EQ(IdsOf(library.Around(x, 20, 0).nearest), BruteForce(entries, x, 20)) << size;
    }
  }
}

// The spread is that of the last index; within one index every order of additions and removals finds the same.
TEST(ScenarioLibrary, FindsWhatWasAddedSinceAndNotWhatWasRemoved) {
  Random random(2);
  std::vector<LibraryEntry> entries;
  for (int i = 0; i < 2000; ++i) entries.push_back(Entry(absl::StrCat(i), Start(random)));
  ScenarioLibrary library(kSettlingDistance);
  library.Add(entries);
  const ErrorState x = Start(random);
  for (int i = 0; i < 100; ++i) {
    const auto nearest = library.Around(x, 3, 0).nearest;
    ASSERT_EQ(nearest.size(), 3u);
    library.Remove(nearest[0].entry.id);
    const auto after = library.Around(x, 2, 0).nearest;
    EXPECT_EQ(after[0].entry.id, nearest[1].entry.id);
    EXPECT_EQ(after[1].entry.id, nearest[2].entry.id);
    const LibraryEntry added = Entry(absl::StrCat("new", i), x);
    library.Add({&added, 1});
    EXPECT_EQ(library.Around(x, 1, 0).nearest[0].entry.id, added.id);
    EXPECT_EQ(library.Around(x, 1, 0).nearest[0].distance, 0);
    library.Remove(added.id);
    EXPECT_EQ(library.Around(x, 1, 0).nearest[0].entry.id, nearest[1].entry.id);
  }
  EXPECT_EQ(library.size(), 1900u);
  EXPECT_EQ(library.Around(x, 5000, 0).nearest.size(), 1900u);
}

TEST(ScenarioLibrary, RemovesAllAndBeginsAnew) {
  Random random(3);
  ScenarioLibrary library(kSettlingDistance);
  for (int i = 0; i < 700; ++i) {
    const LibraryEntry entry = Entry(absl::StrCat(i), Start(random));
    library.Add({&entry, 1});
  }
  for (int i = 0; i < 700; ++i) library.Remove(absl::StrCat(i));
  library.Remove("never there");
  const auto around = library.Around({}, 5, 5);
  EXPECT_EQ(around.position.library_size, 0u);
  EXPECT_TRUE(around.nearest.empty());
  EXPECT_FALSE(around.mean);
  EXPECT_TRUE(around.position.extrapolated);
  EXPECT_TRUE(std::isnan(around.position.nearest_distance));
  const LibraryEntry entry = Entry("0", {});
  library.Add({&entry, 1});
  EXPECT_EQ(library.Around({}, 5, 5).position.library_size, 1u);
}

TEST(ScenarioLibrary, TakesAnIdOnce) {
  ScenarioLibrary library(kSettlingDistance);
  const std::vector<LibraryEntry> entries = {Entry("a", {}, 1), Entry("a", {.x1 = 1}, 2), General("b"), General("b")};
  library.Add(entries);
  library.Add(entries);
  EXPECT_EQ(library.size(), 2u);
  EXPECT_EQ(library.Around({}, 5, 5).nearest.front().entry.gains[0], 1);
}

TEST(ScenarioLibrary, KeepsGeneralOnesApartNewestFirst) {
  ScenarioLibrary library(kSettlingDistance);
  const std::vector<LibraryEntry> entries = {General("first"), Entry("placed", {}), General("second"),
                                             General("third")};
  library.Add(entries);
  library.Remove("second");
  const auto around = library.Around({}, 9, 1);
  EXPECT_THAT(IdsOf(around.nearest), ElementsAre("placed"));
  ASSERT_EQ(around.general.size(), 1u);
  EXPECT_EQ(around.general[0].id, "third");
  EXPECT_EQ(library.Around({}, 9, 9).general.size(), 2u);
  EXPECT_EQ(around.position.library_size, 3u);
  EXPECT_EQ(around.position.located, 1u);
}

TEST(ScenarioLibrary, WholeTurnsOfLongitudeAreNoDistance) {
  ScenarioLibrary library(kSettlingDistance);
  const std::vector<LibraryEntry> entries = {Entry("a", {.x1 = 0.1}), Entry("b", {.x1 = -0.5})};
  library.Add(entries);
  const auto around = library.Around({.x1 = 0.1 + 4 * std::numbers::pi}, 1, 0);
  EXPECT_EQ(around.nearest[0].entry.id, "a");
  EXPECT_NEAR(around.nearest[0].distance, 0, 1e-9);
}

TEST(ScenarioLibrary, MeanIsGeometricAndFollowsChanges) {
  ScenarioLibrary library(kSettlingDistance);
  const std::vector<LibraryEntry> entries = {Entry("a", {}, 1), Entry("b", {.x1 = 1}, 100), Entry("c", {.x1 = 2}, 7)};
  library.Add(entries);
  library.Remove("c");
  EXPECT_NEAR((*library.Around({}, 0, 0).mean)[3], 10, 1e-12);
}

TEST(ScenarioLibrary, ASingleStartIsGoodForItsNeighbourhoodOnly) {
  ScenarioLibrary library(kSettlingDistance);
  const LibraryEntry entry = Entry("a", {.x1 = 0.1});
  library.Add({&entry, 1});
  EXPECT_FALSE(library.Around({.x1 = 0.1 + 0.9 * kSettlingDistance}, 1, 0).position.extrapolated);
  EXPECT_TRUE(library.Around({.x1 = 0.1 + 1.1 * kSettlingDistance}, 1, 0).position.extrapolated);
}

// Held-out draws of the library's own distribution are inside, but for a few; far ones are outside, in every direction.
TEST(ScenarioLibrary, TellsExtrapolationFromTheLibrarysOwnSpread) {
  for (const int size : {50, 5000}) {
    Random random(4);
    std::vector<LibraryEntry> entries;
    for (int i = 0; i < size; ++i) entries.push_back(Entry(absl::StrCat(i), Start(random)));
    ScenarioLibrary library(kSettlingDistance);
    library.Add(entries);
    int inside = 0;
    constexpr int kHeldOut = 200;
    for (int i = 0; i < kHeldOut; ++i) inside += library.Around(Start(random), 1, 0).position.extrapolated ? 0 : 1;
    EXPECT_GE(inside, kHeldOut * 95 / 100) << size;
    for (const ErrorState& far : {ErrorState{.x1 = 0.1}, ErrorState{.x2 = -0.01}, ErrorState{.x4 = 0.001},
                                  ErrorState{.x6 = 0.02}, ErrorState{.x1 = 0.05, .x3 = 0.005}}) {
      const LibraryPosition position = library.Around(far, 1, 0).position;
      EXPECT_TRUE(position.extrapolated) << size << ": " << position.nearest_distance;
      EXPECT_GT(position.centre_distance, 5);
    }
  }
}

// Several tunings of each start must not make every other start look far.
TEST(ScenarioLibrary, SeveralGainSetsOfOneStartAreOnePlace) {
  Random random(5);
  std::vector<LibraryEntry> entries;
  for (int i = 0; i < 60; ++i) {
    const ErrorState start = Start(random);
    for (int seed = 0; seed < 4; ++seed) entries.push_back(Entry(absl::StrCat(i, "-", seed), start));
  }
  ScenarioLibrary library(kSettlingDistance);
  library.Add(entries);
  int inside = 0;
  for (int i = 0; i < 100; ++i) inside += library.Around(Start(random), 1, 0).position.extrapolated ? 0 : 1;
  EXPECT_GE(inside, 90);
}

TEST(ScenarioLibrary, ReadsRunBesideChanges) {
  Random random(6);
  std::vector<LibraryEntry> entries;
  for (int i = 0; i < 3000; ++i) entries.push_back(Entry(absl::StrCat(i), Start(random)));
  ScenarioLibrary library(kSettlingDistance);
  library.Add(std::span(entries).first(100));
  std::atomic<bool> done = false;
  std::vector<std::thread> readers;
  for (int r = 0; r < 2; ++r) {
    readers.emplace_back([&, r] {
      Random own(static_cast<std::uint64_t>(100 + r));
      while (!done) {
        const auto around = library.Around(Start(own), 10, 1);
        ASSERT_EQ(around.nearest.size(), 10u);
        ASSERT_TRUE(std::ranges::is_sorted(around.nearest, {}, &ScenarioLibrary::Neighbour::distance));
      }
    });
  }
  for (std::size_t i = 100; i < entries.size(); ++i) {
    library.Add({&entries[i], 1});
    if (i % 3 == 0) library.Remove(absl::StrCat(i / 2));
  }
  done = true;
  for (std::thread& reader : readers) reader.join();
  EXPECT_EQ(library.Around({}, 5000, 0).nearest.size(), library.size());
}

TEST(GainLibrary, KeepsEachScenarioApart) {
  GainLibrary library;
  const Scenario& leo = *FindPreset("leo-rendezvous");
  EXPECT_EQ(library.Find("digest"), nullptr);
  const LibraryEntry entry = Entry("a", {});
  library.Add("digest", leo, {&entry, 1});
  library.Add("other", *FindPreset("gto-geo"), {&entry, 1});
  EXPECT_EQ(library.Find("digest")->size(), 1u);
  EXPECT_EQ(library.Definitions().size(), 2u);
  library.Remove("digest", "a");
  library.Remove("unknown", "a");
  EXPECT_EQ(library.Find("digest")->size(), 0u);
  ASSERT_EQ(library.Definitions().size(), 1u);
  EXPECT_EQ(library.Definitions()[0].id, "gto-geo");
}

}  // namespace
}  // namespace orbitune
