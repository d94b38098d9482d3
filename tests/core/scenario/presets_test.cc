// The presets against docs/model.md, section 6, whose numbers are repeated here.
#include "core/scenario/presets.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/sim/scalar_simulator.h"

namespace orbitune {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

const Scenario& Preset(std::string_view id) {
  const Scenario* preset = FindPreset(id);
  EXPECT_NE(preset, nullptr) << id;
  return *preset;
}

TEST(PresetsTest, AreThreeAndValid) {
  ASSERT_EQ(Presets().size(), 3u);
  EXPECT_EQ(Presets()[0].id, "gto-geo");
  EXPECT_EQ(Presets()[1].id, "gto-geo-printed");
  EXPECT_EQ(Presets()[2].id, "leo-rendezvous");
  for (const Scenario& preset : Presets()) {
    EXPECT_TRUE(preset.Validate().ok()) << preset.Validate();
    EXPECT_TRUE(preset.search.Validate().ok()) << preset.search.Validate();
    EXPECT_EQ(FindPreset(preset.id), &preset);
    EXPECT_FALSE(preset.display_name.empty());
    EXPECT_FALSE(preset.description.empty());
    EXPECT_EQ(preset.gravitational_parameter_km3_s2, 398600.4418);
    EXPECT_EQ(preset.control_hold, ControlHold::kContinuous);
  }
  EXPECT_EQ(FindPreset(""), nullptr);
  EXPECT_EQ(FindPreset("gto"), nullptr);
}

void ExpectPapersSearch(const SearchOptions& search) {
  EXPECT_EQ(search.step_size, 5e-3);
  EXPECT_EQ(search.exploration_scale, 2e-3);
  EXPECT_EQ(search.directions, 16);
  EXPECT_EQ(search.initial_gains, (Gains{0.1, 1, 1, 1, 10}));
  EXPECT_EQ(search.gain_floor, 1e-3);
}

TEST(PresetsTest, GtoGeo) {
  const Scenario& s = Preset("gto-geo");
  EXPECT_EQ(s.sampling_period_s, 2700);
  EXPECT_EQ(s.horizon_samples, 1280);
  EXPECT_EQ(s.fuel_weight, 50);
  EXPECT_EQ(s.settling_distance_km, 10);
  EXPECT_EQ(s.search.iterations, 2000);
  ExpectPapersSearch(s.search);
  EXPECT_EQ(s.search.exploration_std, (Gains{std::sqrt(0.1), 1, 1, 1, std::sqrt(10.0)}));

  const auto target = Resolve(s.target, s.gravitational_parameter_km3_s2);
  EXPECT_EQ(target->p, 42165);
  EXPECT_EQ(target->eccentricity(), 0);
  EXPECT_EQ(std::hypot(target->hx, target->hy), 0);
  EXPECT_EQ(target->true_longitude, 0);
  const auto chaser = ToKeplerian(*Resolve(s.chaser, s.gravitational_parameter_km3_s2));
  EXPECT_NEAR(chaser->semi_major_axis, 24364, 1e-9);
  EXPECT_NEAR(chaser->eccentricity, 0.7306, 1e-14);
  EXPECT_NEAR(chaser->inclination, 63 * kDegree, 1e-14);
  EXPECT_NEAR(chaser->raan, 75 * kDegree, 1e-14);
  const double longitude_of_periapsis = chaser->raan + chaser->argument_of_periapsis;
  EXPECT_NEAR(std::remainder(longitude_of_periapsis, 2 * std::numbers::pi), -127 * kDegree, 1e-14);
  EXPECT_NEAR(std::remainder(longitude_of_periapsis + chaser->true_anomaly, 2 * std::numbers::pi), 30 * kDegree, 1e-14);

  const auto prepared = Prepare(s);
  ASSERT_TRUE(prepared.ok());
  EXPECT_NEAR(prepared->acceleration_unit_m_s2, 0.672596837743744, 1e-14);  // 3 mu / p_r^2
  EXPECT_NEAR(prepared->velocity_unit_m_s, 3074.62982397692, 1e-10);        // sqrt(mu / p_r)
  EXPECT_NEAR(prepared->problem.gain_units.acceleration, 3, 1e-15);
  EXPECT_NEAR(prepared->problem.gain_units.velocity, 1, 1e-15);
}

TEST(PresetsTest, GtoGeoPrintedIsItsMirrorImage) {
  const Scenario &s = Preset("gto-geo"), &printed = Preset("gto-geo-printed");
  const auto chaser = *Resolve(s.chaser, s.gravitational_parameter_km3_s2);
  const auto mirrored = *Resolve(printed.chaser, s.gravitational_parameter_km3_s2);
  EXPECT_EQ(mirrored.p, chaser.p);
  EXPECT_NEAR(mirrored.ex, chaser.ex, 1e-15);
  EXPECT_NEAR(mirrored.ey, -chaser.ey, 1e-15);
  EXPECT_EQ(mirrored.hx, chaser.hx);
  EXPECT_EQ(mirrored.hy, chaser.hy);
  EXPECT_NEAR(mirrored.true_longitude, chaser.true_longitude, 1e-15);
  EXPECT_EQ(printed.sampling_period_s, s.sampling_period_s);
  EXPECT_EQ(printed.fuel_weight, s.fuel_weight);
  EXPECT_EQ(printed.settling_distance_km, s.settling_distance_km);
  EXPECT_EQ(printed.acceleration_unit_m_s2, s.acceleration_unit_m_s2);
}

TEST(PresetsTest, LeoRendezvous) {
  const Scenario& s = Preset("leo-rendezvous");
  EXPECT_EQ(s.sampling_period_s, 180);
  EXPECT_EQ(s.horizon_samples, 1280);
  EXPECT_EQ(s.fuel_weight, 400);
  EXPECT_EQ(s.settling_distance_km, 1);
  EXPECT_EQ(s.search.iterations, 5000);
  ExpectPapersSearch(s.search);
  EXPECT_EQ(s.search.exploration_std, (Gains{0.1, 1, 1, 1, 10}));

  const auto target = *Resolve(s.target, s.gravitational_parameter_km3_s2);
  const auto keplerian = *ToKeplerian(target);
  EXPECT_NEAR(keplerian.semi_major_axis, 7378.137, 1e-9);
  EXPECT_EQ(keplerian.eccentricity, 0);
  EXPECT_NEAR(keplerian.inclination, 81 * kDegree, 1e-14);
  EXPECT_EQ(keplerian.raan, 0);
  EXPECT_NEAR(target.true_longitude, 45 * kDegree, 1e-15);
  const auto chaser = *Resolve(s.chaser, s.gravitational_parameter_km3_s2);
  EXPECT_NEAR(chaser.true_longitude - target.true_longitude, 0.4 * kDegree, 1e-14);
  EXPECT_NEAR(chaser.p - target.p, 15, 1e-11);
  EXPECT_NEAR(chaser.ex, 3e-5, 1e-18);
  EXPECT_NEAR(chaser.ey, -2e-5, 1e-18);
  EXPECT_NEAR(chaser.hx - target.hx, 1.5e-3, 1e-15);
  EXPECT_NEAR(chaser.hy, -1e-3, 1e-18);
  EXPECT_NEAR(Prepare(s)->problem.gain_units.acceleration, 3, 1e-15);
}

TEST(PresetsTest, CostOfTheFirstGainsIsTheModels) {
  const EpisodeResult result = SimulateEpisode(Prepare(Preset("gto-geo"))->problem, {0.1, 1, 1, 1, 10});
  EXPECT_EQ(result.outcome, Outcome::kSettled);
  EXPECT_EQ(result.settling_samples, 343);
  EXPECT_NEAR(result.cost, 812.628, 5e-4);
}

TEST(PresetsTest, FirstGainsSettleTheRendezvous) {
  const Scenario& s = Preset("leo-rendezvous");
  EXPECT_EQ(SimulateEpisode(Prepare(s)->problem, s.search.initial_gains).outcome, Outcome::kSettled);
}

}  // namespace
}  // namespace orbitune
