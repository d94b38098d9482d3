#include "client/cli/parse.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "client/cli/initial_condition.h"
#include "client/cli/number.h"

namespace orbitune::cli {
namespace {

std::string InitialConditionError(const std::string& text) {
  const auto state = ParseInitialCondition(text);
  return state.ok() ? "" : std::string(state.status().message());
}

TEST(Number, TakesTheWholeTextOrNothing) {
  EXPECT_EQ(*ParseNumber<double>("-1.5e3"), -1500);
  EXPECT_TRUE(std::isnan(*ParseNumber<double>("nan")));
  EXPECT_TRUE(std::isinf(*ParseNumber<double>("inf")));
  EXPECT_EQ(*ParseNumber<std::uint64_t>("18446744073709551615"), UINT64_MAX);
  for (const char* bad : {"", "1x", " 1", "1 ", "1,5", "0x10", "1e999"})
    EXPECT_FALSE(ParseNumber<double>(bad).ok()) << bad;
  for (const char* bad : {"1.0", "2147483648", "1e3"}) EXPECT_FALSE(ParseNumber<std::int32_t>(bad).ok()) << bad;
  EXPECT_FALSE(ParseNumber<std::uint64_t>("-1").ok());
}

TEST(Gains, AreExactlyFiveNumbers) {
  const auto gains = ParseGains("0.1,1,2,nan,10");
  ASSERT_TRUE(gains.ok());
  EXPECT_EQ(gains->k1(), 0.1);
  EXPECT_EQ(gains->k3(), 2);
  EXPECT_TRUE(std::isnan(gains->k4()));  // for the server to refuse
  EXPECT_EQ(gains->k5(), 10);
  for (const char* bad : {"", "1,2,3,4", "1,2,3,4,5,6", "1,2,3,4,", "1,2,3,4,5x", "1 2 3 4 5"}) {
    EXPECT_FALSE(ParseGains(bad).ok()) << bad;
  }
}

TEST(Names, AreCompleted) {
  EXPECT_EQ(ResourceName("jobs", "abc"), "jobs/abc");
  EXPECT_EQ(ResourceName("jobs", "jobs/abc"), "jobs/abc");
  EXPECT_EQ(ResourceName("jobs", ""), "");
}

TEST(Uuid, IsWellFormedAndNew) {
  std::set<std::string> seen;
  for (int i = 0; i < 100; ++i) {
    const std::string uuid = RandomUuid();
    ASSERT_EQ(uuid.size(), 36u);
    EXPECT_EQ(uuid[14], '4');
    EXPECT_NE(std::string("89ab").find(uuid[19]), std::string::npos);
    EXPECT_TRUE(seen.insert(uuid).second);
  }
}

TEST(InitialCondition, KeysTellTheForm) {
  const std::string kepler =
      "semi_major_axis_km=24364,eccentricity=0.7306,inclination_deg=63,raan_deg=75,"
      "argument_of_periapsis_deg=158";
  auto state = ParseInitialCondition(kepler + ",true_longitude_deg=30");
  ASSERT_TRUE(state.ok()) << state.status();
  EXPECT_EQ(state->keplerian().eccentricity(), 0.7306);
  EXPECT_EQ(state->keplerian().true_longitude_deg(), 30);
  state = ParseInitialCondition(kepler);
  ASSERT_TRUE(state.ok()) << state.status();
  EXPECT_EQ(state->keplerian().position_case(), v1::KeplerianElements::POSITION_NOT_SET);
  state = ParseInitialCondition("true_longitude_deg=45,p_km=7378,ex=0,ey=0,hx=-1e-3,hy=0");
  ASSERT_TRUE(state.ok()) << state.status();
  EXPECT_EQ(state->equinoctial().hx(), -1e-3);
  state = ParseInitialCondition("x_km=-7000,y_km=0,z_km=0,x_dot_km_s=0,y_dot_km_s=7.5,z_dot_km_s=0");
  ASSERT_TRUE(state.ok()) << state.status();
  EXPECT_EQ(state->cartesian().x_km(), -7000);
}

TEST(InitialCondition, ErrorsNameTheKeyAndWhatIsAllowed) {
  const std::string kepler =
      "semi_major_axis_km=7000,eccentricity=0,inclination_deg=0,raan_deg=0,"
      "argument_of_periapsis_deg=0";
  struct Case {
    std::string text;
    std::vector<std::string> parts;
  };
  for (const Case& c : std::vector<Case>{
           {"p_km=7000,x_km=1,ex=0", {"'x_km'", "equinoctial", "p_km, ex, ey, hx, hy, true_longitude_deg"}},
           {"height_km=1", {"'height_km'", "keplerian:", "equinoctial:", "cartesian: x_km"}},
           {kepler + ",wrong=1", {"'wrong'", "keplerian", "true_anomaly_deg|true_longitude_deg"}},
           {kepler + ",true_anomaly_deg=1,true_longitude_deg=2", {"'true_longitude_deg'", "true_anomaly_deg"}},
           {"x_km=1,x_km=2", {"'x_km'", "twice"}},
           {"x_km=1km", {"x_km", "'1km'"}},
           {"x_km=1,", {"key=value"}},
           {"x_km=1,y_km=2", {"cartesian", "lacks z_km, x_dot_km_s, y_dot_km_s, z_dot_km_s"}},
           {"/no/such.json", {"/no/such.json", "No such file"}}}) {
    const std::string error = InitialConditionError(c.text);
    for (const std::string& part : c.parts) EXPECT_NE(error.find(part), std::string::npos) << c.text << " -> " << error;
  }
}

}  // namespace
}  // namespace orbitune::cli
