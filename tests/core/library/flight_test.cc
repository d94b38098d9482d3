#include "core/library/flight.h"

#include <gtest/gtest.h>

#include "core/scenario/presets.h"
#include "core/sim/scalar_simulator.h"

namespace orbitune {
namespace {

constexpr Gains kInitialGains{0.1, 1, 1, 1, 10};

PreparedScenario Prepared(const char* preset) { return *Prepare(*FindPreset(preset)); }

TEST(Flight, HasTheEffortInPhysicalUnits) {
  const PreparedScenario prepared = Prepared("leo-rendezvous");
  const Flight flight =
      ToFlight(FlyWatched(prepared.problem, kInitialGains, {.early_exit = true}), prepared, kInitialGains);
  // docs/model.md, "Presets".
  EXPECT_EQ(flight.outcome, Outcome::kSettled);
  EXPECT_NEAR(flight.cost, 313.298, 1e-3);
  EXPECT_NEAR(flight.settling_time_s, 14.25 * 3600, 1);
  EXPECT_NEAR(flight.delta_v_m_s, 263.8, 0.1);
  EXPECT_NEAR(flight.peak_acceleration_m_s2, 0.149, 1e-3);
  EXPECT_TRUE(flight.certificate.gains_positive);
  EXPECT_TRUE(flight.certificate.domain_guaranteed);
  EXPECT_TRUE(flight.certificate.lyapunov_decreasing);
  EXPECT_TRUE(flight.certificate.settled);
}

TEST(Flight, StopsAtTheProofWithTheSameAnswer) {
  const PreparedScenario prepared = Prepared("gto-geo");
  const Flight early =
      ToFlight(FlyWatched(prepared.problem, kInitialGains, {.early_exit = true}), prepared, kInitialGains);
  const Flight whole =
      ToFlight(FlyWatched(prepared.problem, kInitialGains, {.early_exit = false}), prepared, kInitialGains);
  EXPECT_EQ(early.cost, whole.cost);
  EXPECT_EQ(early.delta_v_m_s, whole.delta_v_m_s);
  EXPECT_EQ(early.settling_time_s, whole.settling_time_s);
  EXPECT_TRUE(whole.certificate.lyapunov_decreasing);
}

TEST(Flight, OutsideTheDomainHasNoCostAndNoSettlingTime) {
  const PreparedScenario prepared = Prepared("gto-geo-printed");
  const Flight flight = ToFlight(FlyWatched(prepared.problem, kInitialGains, {}), prepared, kInitialGains);
  EXPECT_EQ(flight.outcome, Outcome::kLeftDomain);
  EXPECT_TRUE(std::isnan(flight.cost));
  EXPECT_TRUE(std::isnan(flight.settling_time_s));
  EXPECT_FALSE(flight.certificate.domain_guaranteed);
  EXPECT_FALSE(flight.certificate.settled);
}

// With a hold of several radians of phase V rises between samples: the proof does not cover a held control.
TEST(Flight, NoticesALyapunovFunctionThatRises) {
  Scenario scenario = *FindPreset("leo-rendezvous");
  scenario.control_hold = ControlHold::kZeroOrder;
  scenario.sampling_period_s = 1800;
  scenario.horizon_samples = 50;
  const auto prepared = Prepare(scenario);
  ASSERT_TRUE(prepared.ok());
  std::vector<EpisodeSample> samples;
  const WatchedEpisode episode = FlyWatched(prepared->problem, kInitialGains, {.trajectory = &samples});
  const bool rises = std::ranges::adjacent_find(samples, [](const auto& a, const auto& b) {
                       return b.lyapunov > 1.01 * a.lyapunov;
                     }) != samples.end();
  ASSERT_TRUE(rises) << "the scenario does not show what it is for";
  EXPECT_FALSE(episode.lyapunov_decreasing);
}

TEST(Flight, DoesNotChangeTheEpisode) {
  const PreparedScenario prepared = Prepared("leo-rendezvous");
  const EpisodeResult plain = SimulateEpisode(prepared.problem, kInitialGains, {.measure_effort = true});
  const WatchedEpisode watched = FlyWatched(prepared.problem, kInitialGains, {});
  EXPECT_EQ(watched.result.cost, plain.cost);
  EXPECT_EQ(watched.result.delta_v_to_settling, plain.delta_v_to_settling);
  EXPECT_EQ(watched.result.peak_acceleration, plain.peak_acceleration);
}

}  // namespace
}  // namespace orbitune
