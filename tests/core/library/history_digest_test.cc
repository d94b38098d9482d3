// The digest chain against its description, and against values that an independent program (Python's hashlib) gave.
#include "core/library/history_digest.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"
#include "core/library/scenario_digest.h"
#include "core/scenario/presets.h"

namespace orbitune {
namespace {

TEST(DigestTest, IsSha256) {
  EXPECT_EQ(ToHex(Sha256("")), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(ToHex(Sha256("abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(DigestTest, ReadsBackWhatItWrites) {
  const Digest digest = Sha256("abc");
  EXPECT_EQ(DigestFromHex(ToHex(digest)), digest);
  const std::string text = ToHex(digest);
  EXPECT_EQ(DigestFromHex(text.substr(1)), std::nullopt);
  EXPECT_EQ(DigestFromHex(absl::StrCat(text, "00")), std::nullopt);
  EXPECT_EQ(DigestFromHex(absl::StrCat("B", text.substr(1))), std::nullopt);
  EXPECT_EQ(DigestFromHex(absl::StrCat("g", text.substr(1))), std::nullopt);
}

IterationRecord Record() { return {.iteration = 258, .gains = {0.1, 1, -2.5, 1e-300, 10}, .cost = 812.628}; }

// hashlib.sha256(hashlib.sha256(b"start").digest() + struct.pack("<I6d", 258, 0.1, 1, -2.5, 1e-300, 10, 812.628))
TEST(HistoryDigestTest, IsWhatPythonMakesOfTheLayout) {
  EXPECT_EQ(ToHex(ExtendHistory(Sha256("start"), Record())),
            "e13aedec1071dde83ba0bcd472d26f195551002359972e69b0033ccf7fa7ba9c");
}

TEST(HistoryDigestTest, AnyNaNIsTheCanonicalOne) {
  IterationRecord a = Record();
  a.cost = -std::numeric_limits<double>::quiet_NaN();
  // As above, with float("nan").
  EXPECT_EQ(ToHex(ExtendHistory(Sha256("start"), a)),
            "66a1caa285c33f1cde5afc237134c74d482e2ce49da8d11e4f0219274d6cd5e4");
}

TEST(HistoryDigestTest, EveryBitOfWhatIsChainedCounts) {
  const Digest start = Sha256("start");
  const Digest digest = ExtendHistory(start, Record());
  EXPECT_NE(ExtendHistory(digest, Record()), digest);
  IterationRecord other = Record();
  other.iteration += 1 << 24;
  EXPECT_NE(ExtendHistory(start, other), digest);
  for (std::size_t i = 0; i < kGainCount; ++i) {
    other = Record();
    other.gains[i] = std::nextafter(other.gains[i], 1e9);
    EXPECT_NE(ExtendHistory(start, other), digest) << i;
  }
  other = Record();
  other.cost = std::nextafter(other.cost, 0);
  EXPECT_NE(ExtendHistory(start, other), digest);
}

std::string Inputs(const Scenario& scenario) {
  return InputsText(ScenarioDigest(scenario), scenario, scenario.chaser, {}, {});
}

TEST(InputsTextTest, HasExactNumbersAndNoNames) {
  Scenario scenario = *FindPreset("gto-geo");
  scenario.id = scenario.display_name = scenario.description = "secret";
  scenario.search.seed = 18446744073709551615u;
  scenario.search.step_size = 0.1;
  const std::string text = Inputs(scenario);
  EXPECT_TRUE(text.starts_with("orbitune job 1\n")) << text;
  EXPECT_NE(text.find("\nhyperparameters.seed=18446744073709551615\n"), text.npos) << text;
  EXPECT_NE(text.find("\nhyperparameters.step_size=3fb999999999999a\n"), text.npos) << text;
  EXPECT_NE(text.find("\nhyperparameters.algorithm=ALGORITHM_ARS\n"), text.npos) << text;
  EXPECT_NE(text.find(absl::StrCat("\nscenario_digest=", ScenarioDigest(scenario), "\n")), text.npos) << text;
  EXPECT_EQ(text.find("secret"), text.npos);
}

TEST(InputsTextTest, TellsInputsApartByABitAndZerosNotByTheirSign) {
  Scenario scenario = *FindPreset("gto-geo");
  const std::string text = Inputs(scenario);
  Scenario other = scenario;
  other.integration_tolerance = std::nextafter(other.integration_tolerance, 1);
  EXPECT_NE(Inputs(other), text);
  other = scenario;
  other.fuel_weight = std::nextafter(other.fuel_weight, 1e9);
  EXPECT_NE(Inputs(other), text);
  Scenario positive = scenario;
  Scenario negative = scenario;
  positive.velocity_unit_m_s = 0.0;
  negative.velocity_unit_m_s = -0.0;
  EXPECT_EQ(Inputs(positive), Inputs(negative));
}

TEST(InputsTextTest, ARobustJobIsNotTheJobOfItsOnlyStart) {
  const Scenario scenario = *FindPreset("gto-geo");
  const Objective worst{.aggregate = Aggregate::kWorst};
  const auto robust = [&](const Objective& objective) {
    return InputsText(ScenarioDigest(scenario), scenario, scenario.chaser, {&scenario.chaser, 1}, objective);
  };
  EXPECT_NE(robust({}), Inputs(scenario));
  EXPECT_NE(robust({}), robust(worst));
}

}  // namespace
}  // namespace orbitune
