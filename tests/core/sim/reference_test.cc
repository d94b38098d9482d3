// The scalar simulator against tests/reference/episodes.json, on which two programs that share no code with it agree.
#include <gtest/gtest.h>

#include "core/sim/scalar_simulator.h"
#include "tests/tools/episode_file.h"

namespace orbitune {
namespace {

const std::vector<EpisodeCase>& Cases() {
  static const auto* const cases = new std::vector<EpisodeCase>(ReadEpisodeFile(ORBITUNE_REFERENCE_FILE).value());
  return *cases;
}

class ReferenceTest : public ::testing::TestWithParam<std::size_t> {
 protected:
  double Expected(const char* field) const { return episode_.expected[field].get<double>(); }
  double Expected(const char* field, std::size_t i) const { return episode_.expected[field][i].get<double>(); }

  const EpisodeCase& episode_ = Cases().at(GetParam());
  const EpisodeProblem& problem_ = episode_.prepared.problem;
};

TEST_P(ReferenceTest, SameCost) {
  const EpisodeResult result = SimulateEpisode(problem_, episode_.gains, {.measure_effort = true});
  EXPECT_EQ(result.outcome, Outcome::kSettled);
  EXPECT_EQ(result.settling_samples, episode_.expected["settling_samples"].get<int>());
  EXPECT_NEAR(result.fuel_sum / Expected("fuel_sum"), 1, 1e-6);
  EXPECT_NEAR(result.cost / Expected("cost"), 1, 1e-6);
  const double delta_v_m_s = result.delta_v_to_settling * episode_.prepared.units.velocity_m_s();
  EXPECT_NEAR(delta_v_m_s / Expected("delta_v_to_settling_m_s"), 1, 1e-6);
  EXPECT_NEAR(result.initial_lyapunov, Expected("V0"), 1e-9);
}

TEST_P(ReferenceTest, SameBeginning) {
  std::vector<EpisodeSample> trajectory;
  SimulateEpisode(problem_, episode_.gains, {.trajectory = &trajectory});
  const ErrorState& x = trajectory.at(0).error;
  const double values[] = {x.x1, x.x2, x.x3, x.x4, x.x5, x.x6};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(values[i], Expected("x0", i), 1e-9) << "x" << i + 1;
  const Control& u = trajectory[0].control;
  const double components[] = {u.radial, u.transverse, u.normal};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(components[i] / problem_.gain_units.acceleration, Expected("u0", i), 1e-9) << "u" << i;
  }
}

TEST_P(ReferenceTest, LyapunovFunctionNeverRises) {
  std::vector<EpisodeSample> trajectory;
  SimulateEpisode(problem_, episode_.gains, {.early_exit = false, .trajectory = &trajectory});
  ASSERT_EQ(trajectory.size(), static_cast<std::size_t>(problem_.horizon_samples) + 1);
  // Up to what the integrator calls nothing: errors of a step below a hundredth of tolerance * 1e-2 epsilon.
  const double nothing = problem_.tolerance * 1e-2 * problem_.settling_distance;
  for (std::size_t k = 1; k < trajectory.size(); ++k) {
    ASSERT_LE(trajectory[k].lyapunov, trajectory[k - 1].lyapunov * (1 + 1e-12) + nothing * nothing) << "sample " << k;
  }
  EXPECT_LT(trajectory.back().lyapunov, 1e-3 * trajectory.front().lyapunov);
}

INSTANTIATE_TEST_SUITE_P(, ReferenceTest, ::testing::Range<std::size_t>(0, Cases().size()));

TEST(ReferenceFileTest, HoldsAllCases) { EXPECT_EQ(Cases().size(), 13u); }

}  // namespace
}  // namespace orbitune
