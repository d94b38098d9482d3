#include "client/cli/gains_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "client/cli/json.h"
#include "google/protobuf/util/message_differencer.h"

namespace orbitune::cli {
namespace {

using ::testing::HasSubstr;

v1::GainSet Set() {
  v1::GainSet set;
  set.set_name("gainSets/a-1");
  set.set_kind(v1::GAIN_SET_KIND_TUNED);
  set.set_display_name("a \"good\" one, tuned */ here");
  set.set_scenario("scenarios/leo-rendezvous");
  set.set_scenario_digest("0123abcd");
  set.set_velocity_unit_m_s(7350.138629613317);
  set.set_acceleration_unit_m_s2(21.966739520234142);
  set.mutable_gains()->set_k1(0.1);
  set.mutable_gains()->set_k2(1.0 / 3);
  set.mutable_gains()->set_k3(1e-3);
  set.mutable_gains()->set_k4(5e-324);
  set.mutable_gains()->set_k5(123456.789);
  v1::EquinoctialElements& state = *set.mutable_initial_condition()->mutable_equinoctial();
  state.set_p_km(7393.137);
  state.set_ey(-2e-5);
  state.set_true_longitude_deg(45.4);
  set.set_iteration(7);
  set.set_algorithm("CMA_ES");
  set.set_seed(18446744073709551615u);
  set.set_engine_version("0.1.0");
  set.mutable_flight()->set_cost(30.5);
  set.mutable_flight()->mutable_certificate()->set_settled(true);
  return set;
}

// What an import takes of it.
v1::GainSet Imported(v1::GainSet set) {
  set.clear_kind();
  set.clear_flight();
  return set;
}

class GainsFileTest : public ::testing::Test {
 protected:
  ~GainsFileTest() override { std::filesystem::remove_all(directory_); }

  std::string Write(const std::string& name, const std::string& text) const {
    std::filesystem::create_directories(directory_);
    std::ofstream(directory_ / name) << text;
    return (directory_ / name).string();
  }

  std::string Fault(const std::string& text, const std::string& name = "sets.csv") const {
    const auto sets = ReadGainSets(Write(name, text));
    EXPECT_TRUE(absl::IsInvalidArgument(sets.status())) << sets.status();
    return std::string(sets.status().message());
  }

  const std::filesystem::path directory_ =
      std::filesystem::path(::testing::TempDir()) /
      absl::StrCat("gains_file_", ::testing::UnitTest::GetInstance()->current_test_info()->name());
};

void ExpectSame(const v1::GainSet& a, const v1::GainSet& b) {
  EXPECT_TRUE(google::protobuf::util::MessageDifferencer::Equals(a, b)) << a.DebugString() << b.DebugString();
}

TEST_F(GainsFileTest, CrcIsThatOfIeee8023) { EXPECT_EQ(Crc32("123456789"), 0xcbf43926u); }

TEST_F(GainsFileTest, CsvComesBackWithEveryBit) {
  v1::GainSet keplerian = Set();
  keplerian.mutable_initial_condition()->mutable_keplerian()->set_semi_major_axis_km(7000.1);
  keplerian.mutable_initial_condition()->mutable_keplerian()->set_true_longitude_deg(0.1);
  v1::GainSet cartesian = Set();
  cartesian.mutable_initial_condition()->mutable_cartesian()->set_x_km(-1e-9);
  const std::vector<v1::GainSet> sets = {Set(), keplerian, cartesian};
  std::string text = GainSetCsvHeader() + "\r\n";
  for (const v1::GainSet& set : sets) absl::StrAppend(&text, GainSetCsvRow(set), "\n");
  const auto read = ReadGainSets(Write("sets.csv", text));
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) ExpectSame((*read)[i].set, Imported(sets[i]));
  EXPECT_THAT((*read)[1].where, HasSubstr("sets.csv:3"));
}

TEST_F(GainsFileTest, JsonComesBackWhole) {
  v1::GainSet set = Set();
  set.mutable_scenario_definition()->set_fuel_weight(400);
  const auto read = ReadGainSets(Write("sets.json", JsonPretty(ToGainSetFile({set, Set()}))));
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->size(), 2u);
  EXPECT_EQ((*read)[0].set.gains().k2(), 1.0 / 3);
  EXPECT_EQ((*read)[0].set.scenario_definition().fuel_weight(), 400);
}

TEST_F(GainsFileTest, ColumnsMayBeFewAndInAnyOrder) {
  const auto read = ReadGainSets(Write("sets.csv",
                                       "k5,k4,k3,k2,k1,initial_condition,scenario\n"
                                       "10,1,1,1,0.1,\"p_km=7393.1,ex=0,ey=0,hx=0,hy=0,true_longitude_deg=45\",leo\n"));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->at(0).set.gains().k5(), 10);
  EXPECT_EQ(read->at(0).set.initial_condition().equinoctial().p_km(), 7393.1);
}

TEST_F(GainsFileTest, ADamagedRowIsNamedByLineAndColumn) {
  const std::string header = GainSetCsvHeader() + "\n";
  const std::string row = GainSetCsvRow(Set());
  EXPECT_THAT(Fault(header + row + "\n" + absl::StrReplaceAll(row, {{"0.3333333333333333", "0.3333333333333334"}})),
              AllOf(HasSubstr("sets.csv:3"), HasSubstr("crc32")));
  EXPECT_THAT(Fault(header + row.substr(0, row.size() / 2)), AllOf(HasSubstr("sets.csv:2"), HasSubstr("cells")));
  EXPECT_THAT(Fault(header + row.substr(0, 30)), HasSubstr("sets.csv:2"));
  EXPECT_THAT(Fault("name,nonsense\n"), AllOf(HasSubstr("sets.csv:1"), HasSubstr("nonsense")));
  EXPECT_THAT(Fault("scenario,k1,k2,k3,k4\n"), HasSubstr("k5 is missing"));
  EXPECT_THAT(Fault("scenario,k1,k1\n"), HasSubstr("k1 comes twice"));
  EXPECT_THAT(Fault("scenario,k1,k2,k3,k4,k5,initial_condition\nleo,1,1,one,1,1,\n"),
              AllOf(HasSubstr("sets.csv:2: column k3"), HasSubstr("one")));
  EXPECT_THAT(Fault("scenario,k1,k2,k3,k4,k5,initial_condition\nleo,1,1,1,1,1,p_km=3\n"),
              HasSubstr("column initial_condition"));
  EXPECT_THAT(Fault(header), HasSubstr("no gain set"));
  EXPECT_THAT(Fault(""), HasSubstr("sets.csv"));
  EXPECT_THAT(Fault("\x7f"
                    "ELF\x01\x02",
                    "sets.csv"),
              HasSubstr("sets.csv:1"));
}

TEST_F(GainsFileTest, DamagedJsonIsNamed) {
  const std::string json = JsonPretty(ToGainSetFile({Set(), Set()}));
  EXPECT_THAT(Fault(json.substr(0, json.size() / 2), "sets.json"), HasSubstr("sets.json"));
  EXPECT_THAT(Fault(absl::StrReplaceAll(json, {{"123456.789", "123456.788"}}), "sets.json"),
              AllOf(HasSubstr("gain_sets[0]"), HasSubstr("crc32")));
  EXPECT_THAT(Fault("{\"gain_sets\": [{\"gain_set\": {\"gians\": {}}}]}", "sets.json"), HasSubstr("gians"));
}

// The header as flight software takes it: compiled, its doubles read, its checksum computed anew.
TEST_F(GainsFileTest, CHeaderCompilesAndItsChecksumHolds) {
  Write("gains.h", GainSetCHeader(Set()));
  const std::string program = R"c(
#include "gains.h"
#include <stdio.h>
#include <string.h>
static unsigned long crc(const unsigned char* p, unsigned long n) {
  unsigned long c = 0xfffffffful, i;
  int k;
  for (i = 0; i < n; ++i) {
    c ^= p[i];
    for (k = 0; k < 8; ++k) c = (c & 1ul) ? (c >> 1) ^ 0xedb88320ul : c >> 1;
  }
  return c ^ 0xfffffffful;
}
int main(void) {
  unsigned char bytes[56];
  memcpy(bytes, orbitune_gains_a_1, 40);
  memcpy(bytes + 40, &orbitune_gains_a_1_velocity_unit_m_s, 8);
  memcpy(bytes + 48, &orbitune_gains_a_1_acceleration_unit_m_s2, 8);
  if (orbitune_gains_a_1[0] != 0.1 || orbitune_gains_a_1[1] != 1.0 / 3 || orbitune_gains_a_1[4] != 123456.789) return 1;
  return crc(bytes, 56) == orbitune_gains_a_1_crc32 ? 0 : 2;
}
)c";
  const std::string source = Write("main.c", program);
  for (const char* language : {"-x c -std=c99", "-x c++ -std=c++17"}) {
    const std::string binary = (directory_ / "main").string();
    const std::string compile =
        absl::StrCat(COMPILER, " ", language, " -Wall -Wextra -pedantic -Werror ", source, " -o ", binary);
    ASSERT_EQ(std::system(compile.c_str()), 0) << language;
    EXPECT_EQ(std::system(binary.c_str()), 0) << language;
  }
}

}  // namespace
}  // namespace orbitune::cli
