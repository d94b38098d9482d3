#include "core/scenario/distribution.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "core/scenario/presets.h"

namespace orbitune {
namespace {

std::vector<OrbitState> Of(const char* preset, std::uint32_t count, DrawSet set = DrawSet::kTuning) {
  const auto states = DrawMany(FindPreset(preset)->neighbourhood, 7, set, 0, count);
  EXPECT_TRUE(states.ok()) << states.status();
  return *states;
}

// docs/model.md, section 6.
TEST(DistributionTest, GtoGeoIsThePapersMirrored) {
  std::set<double> inclinations;
  double mean = 0;
  for (const OrbitState& state : Of("gto-geo", 2000)) {
    const auto& k = std::get<KeplerianState>(state);
    EXPECT_EQ(k.semi_major_axis_km, 24364);
    EXPECT_EQ(k.eccentricity, 0.7306);
    EXPECT_EQ(k.position, KeplerianState::Position::kTrueLongitude);
    EXPECT_EQ(k.position_deg, 30);
    EXPECT_GE(k.inclination_deg, 45);
    EXPECT_LE(k.inclination_deg, 90);
    EXPECT_GE(k.raan_deg, 45);
    EXPECT_LE(k.raan_deg, 90);
    const double printed = -(k.argument_of_periapsis_deg + k.raan_deg) - k.raan_deg;  // omega'
    EXPECT_GE(printed, 45 - 1e-9);
    EXPECT_LE(printed, 90 + 1e-9);
    inclinations.insert(k.inclination_deg);
    mean += k.inclination_deg / 2000;
  }
  EXPECT_EQ(inclinations.size(), 2000u);
  EXPECT_NEAR(mean, 67.5, 4 * 45 / std::sqrt(12.0 * 2000));
}

TEST(DistributionTest, GtoGeoPrintedIsNotMirrored) {
  for (const OrbitState& state : Of("gto-geo-printed", 50)) {
    const auto& k = std::get<KeplerianState>(state);
    EXPECT_GE(k.argument_of_periapsis_deg, 45);
    EXPECT_LE(k.argument_of_periapsis_deg, 90);
  }
}

TEST(DistributionTest, LeoIsNormalAboutTheTarget) {
  const double hx = std::tan(40.5 * std::acos(-1) / 180);
  const int n = 4000;
  const struct {
    double EquinoctialState::*element;
    double mean, std;
  } expected[] = {{&EquinoctialState::true_longitude_deg, 45, 0.5},
                  {&EquinoctialState::p_km, 7378.137, 20},
                  {&EquinoctialState::ex, 0, 3e-5},
                  {&EquinoctialState::ey, 0, 3e-5},
                  {&EquinoctialState::hx, hx, 2e-3},
                  {&EquinoctialState::hy, 0, 2e-3}};
  const auto states = Of("leo-rendezvous", n);
  for (const auto& [element, mean, std] : expected) {
    double sum = 0, squares = 0;
    for (const OrbitState& state : states) {
      const double z = (std::get<EquinoctialState>(state).*element - mean) / std;
      sum += z;
      squares += z * z;
    }
    EXPECT_NEAR(sum / n, 0, 4 / std::sqrt(n));
    EXPECT_NEAR(squares / n, 1, 4 * std::sqrt(2.0 / n));
  }
}

TEST(DistributionTest, ADrawIsAFunctionOfSeedSetAndIndex) {
  const IcDistribution& leo = FindPreset("leo-rendezvous")->neighbourhood;
  const auto all = DrawMany(leo, 3, DrawSet::kTuning, 0, 10);
  const auto some = DrawMany(leo, 3, DrawSet::kTuning, 6, 2);
  const auto p = [](const OrbitState& state) { return std::get<EquinoctialState>(state).p_km; };
  EXPECT_EQ(p((*all)[6]), p((*some)[0]));
  EXPECT_EQ(p((*all)[7]), p((*some)[1]));
  EXPECT_NE(p(*Draw(leo, 4, DrawSet::kTuning, 6)), p((*all)[6]));
  EXPECT_NE(p(*Draw(leo, 3, DrawSet::kHeldOut, 6)), p((*all)[6]));
}

TEST(DistributionTest, AnEllipseIsDrawnAgainUntilItIsOne) {
  KeplerianDistribution d{.semi_major_axis_km = FixedValue{9000}, .eccentricity = NormalVariate{0, 0.5}};
  const auto states = DrawMany(d, 1, DrawSet::kTuning, 0, 200);
  ASSERT_TRUE(states.ok());
  for (const OrbitState& state : *states) EXPECT_TRUE(Resolve(state, 398600).ok());
  d.eccentricity = FixedValue{1.5};
  EXPECT_TRUE(absl::IsInvalidArgument(DrawMany(d, 1, DrawSet::kTuning, 0, 1).status()));
}

TEST(DistributionTest, NamesEveryFieldOutOfRange) {
  std::vector<std::string> faults;
  const KeplerianDistribution d{.semi_major_axis_km = FixedValue{std::nan("")},
                                .inclination_deg = UniformVariate{.low = 10, .high = 5},
                                .position_deg = NormalVariate{.mean = 0, .standard_deviation = -1}};
  for (const FieldViolation& v : FieldViolationsOf(Validate(d))) faults.push_back(v.field + " " + v.description);
  EXPECT_EQ(faults, (std::vector<std::string>{
                        "keplerian.semi_major_axis_km.fixed must be in [-1e9, 1e9], got nan",
                        "keplerian.inclination_deg.uniform.high must be >= low = 10, at most 1e9, got 5",
                        "keplerian.true_anomaly_deg.normal.standard_deviation must be in [0, 1e9], got -1",
                    }));
  EXPECT_FALSE(Validate(IcDistribution()).ok());
}

}  // namespace
}  // namespace orbitune
