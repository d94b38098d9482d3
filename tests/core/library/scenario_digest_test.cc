#include "core/library/scenario_digest.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "core/scenario/presets.h"

namespace orbitune {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::MatchesRegex;

Scenario Leo() { return *FindPreset("leo-rendezvous"); }

TEST(ScenarioDigest, IsTheSameInEveryProcess) {
  // As another SHA-256 program gives it of the text that scenario_digest.cc describes.
  EXPECT_EQ(ScenarioDigest(Leo()), "3222e3aa71526492873e2996956164d2679d76bf8729a74400de39afa9ab24e3");
}

TEST(ScenarioDigest, LeavesOutWhatNoCostDependsOn) {
  Scenario other = Leo();
  other.id = "mine";
  other.display_name = other.description = "another text";
  other.chaser = std::monostate();
  other.integration_tolerance = 1e-7;
  other.search = {.iterations = 3, .initial_gains = {9, 9, 9, 9, 9}, .seed = 7};
  EXPECT_EQ(ScenarioDigest(other), ScenarioDigest(Leo()));
  EXPECT_EQ(ScenarioDigest(LibraryDefinition(Leo())), ScenarioDigest(Leo()));
  EXPECT_THAT(DigestDifferences(Leo(), other), IsEmpty());
}

TEST(ScenarioDigest, KnowsTheDefaultUnits) {
  Scenario given = Leo();
  const auto prepared = Prepare(given);
  ASSERT_TRUE(prepared.ok());
  given.velocity_unit_m_s = prepared->velocity_unit_m_s;
  EXPECT_EQ(ScenarioDigest(given), ScenarioDigest(Leo()));
}

TEST(ScenarioDigest, ChangesWithEverythingThatACostDependsOn) {
  const std::vector<std::pair<const char*, void (*)(Scenario&)>> changes = {
      {"gravitational_parameter_km3_s2", [](Scenario& s) { s.gravitational_parameter_km3_s2 *= 1.01; }},
      {"target.equinoctial.p_km", [](Scenario& s) { std::get<EquinoctialState>(s.target).p_km += 1e-9; }},
      {"target.equinoctial.ex", [](Scenario& s) { std::get<EquinoctialState>(s.target).ex = 1e-12; }},
      {"target.equinoctial.ey", [](Scenario& s) { std::get<EquinoctialState>(s.target).ey = 1e-12; }},
      {"target.equinoctial.hx", [](Scenario& s) { std::get<EquinoctialState>(s.target).hx += 1e-12; }},
      {"target.equinoctial.hy", [](Scenario& s) { std::get<EquinoctialState>(s.target).hy = 1e-12; }},
      {"target.equinoctial.true_longitude_deg",
       [](Scenario& s) { std::get<EquinoctialState>(s.target).true_longitude_deg = 46; }},
      {"sampling_period_s", [](Scenario& s) { s.sampling_period_s = 181; }},
      {"horizon_samples", [](Scenario& s) { s.horizon_samples = 1279; }},
      {"fuel_weight", [](Scenario& s) { s.fuel_weight = 401; }},
      {"settling_distance_km", [](Scenario& s) { s.settling_distance_km = 1.1; }},
      {"velocity_unit_m_s", [](Scenario& s) { s.velocity_unit_m_s = 1; }},
      {"acceleration_unit_m_s2", [](Scenario& s) { s.acceleration_unit_m_s2 = 1; }},
      {"control_hold", [](Scenario& s) { s.control_hold = ControlHold::kZeroOrder; }},
  };
  std::set<std::string> digests = {ScenarioDigest(Leo())};
  for (const auto& [field, change] : changes) {
    Scenario other = Leo();
    change(other);
    EXPECT_TRUE(digests.insert(ScenarioDigest(other)).second) << field;
    const auto differences = DigestDifferences(Leo(), other);
    ASSERT_FALSE(differences.empty()) << field;
    const bool named = std::ranges::any_of(differences, [&](const std::string& d) { return d.starts_with(field); });
    EXPECT_TRUE(named) << field << ", got " << differences.front();
  }
}

TEST(ScenarioDigest, TellsTwoFormsOfOneOrbitApart) {
  Scenario other = Leo();
  other.target = KeplerianState{.semi_major_axis_km = 7378.137, .inclination_deg = 81, .position_deg = 45};
  EXPECT_NE(ScenarioDigest(other), ScenarioDigest(Leo()));
  EXPECT_THAT(DigestDifferences(other, Leo()),
              ::testing::Contains(MatchesRegex("target.keplerian.inclination_deg: 81 there, none here")));
}

TEST(ScenarioDigest, DifferencesGiveBothValues) {
  Scenario other = Leo();
  other.acceleration_unit_m_s2 = 2;
  other.fuel_weight = 1;
  EXPECT_THAT(
      DigestDifferences(other, Leo()),
      ElementsAre("fuel_weight: 1 there, 400 here", MatchesRegex("acceleration_unit_m_s2: 2 there, 21\\.9667.* here")));
}

}  // namespace
}  // namespace orbitune
