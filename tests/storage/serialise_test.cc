#include "storage/serialise.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>
#include <set>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

using Json = nlohmann::ordered_json;

// Fields that version 1 did not have: they may be missing.
const std::set<std::string> kLater{"algorithm",   "max_episodes",       "plateau_stop", "ars_variants", "cma_es",
                                   "nelder_mead", "initial_conditions", "objective",    "warm_start",   "campaign_id",
                                   "owner"};

JobSpec Reread(const JobSpec& spec) { return *JobSpecFromJson(*ToJson(spec)); }

TEST(Serialise, ReturnsASpecAsItWas) {
  const JobSpec odd = Reread(OddSpec());
  EXPECT_EQ(odd.display_name, OddSpec().display_name);
  EXPECT_EQ(odd.labels, OddSpec().labels);
  EXPECT_EQ(odd.scenario.search.seed, ~std::uint64_t{0});
  EXPECT_EQ(odd.scenario.control_hold, ControlHold::kZeroOrder);
  EXPECT_TRUE(std::signbit(std::get<EquinoctialState>(odd.scenario.target).ex));
  EXPECT_TRUE(std::isinf(std::get<CartesianStateKm>(odd.scenario.chaser).x_km));
  EXPECT_TRUE(std::isnan(std::get<CartesianStateKm>(odd.scenario.chaser).z_km));
  const auto& keplerian = std::get<KeplerianState>(odd.initial_condition);
  EXPECT_EQ(keplerian.position, KeplerianState::Position::kTrueLongitude);
  EXPECT_EQ(keplerian.inclination_deg, 81.3);
  EXPECT_EQ(Difference(odd, OddSpec()), "");
  JobSpec none = PlainSpec();
  none.initial_condition = std::monostate();
  EXPECT_EQ(Reread(none).initial_condition.index(), 0);
}

TEST(Serialise, NamesFieldsAsTheStructsDo) {
  const Json json = Json::parse(*ToJson(PlainSpec()));
  EXPECT_EQ(json["scenario"]["sampling_period_s"], 180.0);
  EXPECT_EQ(json["scenario"]["control_hold"], "CONTINUOUS");
  EXPECT_EQ(json["scenario"]["search"]["step_size"], 5e-3);
  EXPECT_EQ(json["initial_condition"]["equinoctial"]["p_km"], 7378.137 + 15);
}

// What version 1 did not have is written only where it is used: a document, and a digest made of it, stays as it was.
TEST(Serialise, WritesAPlainJobAsVersion1Did) {
  const std::string text = *ToJson(PlainSpec());
  for (const std::string& later : kLater) {
    EXPECT_FALSE(absl::StrContains(text, absl::StrCat("\"", later, "\""))) << later;
  }
  EXPECT_FALSE(absl::StrContains(ToJson(JobReport()), "ensemble"));
  JobSpec spec = PlainSpec();
  spec.scenario.search.algorithm = Algorithm::kCmaEs;
  spec.scenario.search.cma_es.population = 8;
  const Json search = Json::parse(*ToJson(spec))["scenario"]["search"];
  EXPECT_EQ(search["algorithm"], "CMA_ES");
  EXPECT_EQ(search["cma_es"]["population"], 8);
  EXPECT_FALSE(search.contains("nelder_mead"));
}

TEST(Serialise, KeepsEveryBitOfADouble) {
  std::mt19937_64 random(7);
  JobSpec spec = PlainSpec();
  for (int i = 0; i < 5000; ++i) {
    Gains& gains = spec.scenario.search.initial_gains;
    for (double& gain : gains) gain = std::bit_cast<double>(random());
    if (i % 2 == 0) gains[0] = std::bit_cast<double>(random() & 0x800fffffffffffff);  // subnormal
    const Gains reread = Reread(spec).scenario.search.initial_gains;
    for (std::size_t k = 0; k < gains.size(); ++k) {
      if (std::isnan(gains[k])) {
        ASSERT_TRUE(std::isnan(reread[k]));
      } else {
        ASSERT_EQ(std::bit_cast<std::uint64_t>(reread[k]), std::bit_cast<std::uint64_t>(gains[k])) << gains[k];
      }
    }
    spec.scenario.search.seed = random();
    ASSERT_EQ(Reread(spec).scenario.search.seed, spec.scenario.search.seed);
  }
}

TEST(Serialise, ReturnsAReportAsItWas) {
  const JobReport report = OddReport();
  const auto reread = JobReportFromJson(ToJson(report));
  ASSERT_TRUE(reread.ok()) << reread.status();
  EXPECT_EQ(Difference(*reread, report), "");
  EXPECT_EQ(reread->episodes, report.episodes);
  EXPECT_EQ(reread->warnings[1].kind, WarningKind::kGainAtFloor);
  EXPECT_EQ(reread->best.episode.outcome, Outcome::kNotSettled);
  EXPECT_TRUE(std::isnan(reread->initial.episode.cost));
  EXPECT_TRUE(reread->final.episode.domain_guaranteed);
}

TEST(Serialise, NamesEveryState) {
  for (int i = 0; i <= static_cast<int>(JobState::kCancelled); ++i) {
    const auto state = static_cast<JobState>(i);
    EXPECT_EQ(*JobStateOf(NameOf(state)), state);
  }
  EXPECT_EQ(NameOf(JobState::kCancelled), "CANCELLED");
  EXPECT_TRUE(absl::IsDataLoss(JobStateOf("running").status()));
}

// Takes away, then spoils, every field there is, and expects it to be named.
void ExpectDamageNamed(const Json& whole, const Json::json_pointer& at, const std::string& path,
                       const std::function<absl::Status(const std::string&)>& read) {
  for (const auto& [name, value] : whole[at].items()) {
    const std::string field = whole[at].is_array() ? absl::StrCat(path, "[", name, "]") : absl::StrCat(path, ".", name);
    Json spoiled = whole;
    spoiled[at / name] = Json::array({1});
    absl::Status status = read(spoiled.dump());
    EXPECT_TRUE(absl::IsDataLoss(status) && absl::StrContains(status.message(), field)) << field << ": " << status;
    if (whole[at].is_object() && !absl::StartsWith(path, "spec.labels")) {
      Json lacking = whole;
      lacking[at].erase(name);
      EXPECT_EQ(absl::IsDataLoss(read(lacking.dump())), !kLater.contains(name)) << field;
    }
    if (value.is_structured()) ExpectDamageNamed(whole, at / name, field, read);
  }
}

absl::Status ReadSpec(const std::string& text) { return JobSpecFromJson(text).status(); }
absl::Status ReadReport(const std::string& text) { return JobReportFromJson(text).status(); }

TEST(Serialise, NamesWhatIsDamaged) {
  ExpectDamageNamed(Json::parse(*ToJson(OddSpec())), Json::json_pointer(), "spec", ReadSpec);
  Json report = Json::parse(ToJson(OddReport()));
  for (const char* part : {"initial", "final", "best"}) {
    for (const auto& [name, value] : report[part]["episode"].items()) {
      Json lacking = report;
      lacking[part]["episode"].erase(name);
      EXPECT_EQ(ReadReport(lacking.dump()).message(),
                absl::StrCat("damaged document: report.", part, ".episode.", name, " is missing"));
    }
  }
}

TEST(Serialise, RefusesWhatIsOutOfRangeOrUnknown) {
  const Json whole = Json::parse(*ToJson(PlainSpec()));
  const auto with = [&whole](const char* pointer, const Json& value) {
    Json changed = whole;
    changed[Json::json_pointer(pointer)] = value;
    return ReadSpec(changed.dump());
  };
  EXPECT_TRUE(with("/scenario/horizon_samples", 7).ok());
  EXPECT_TRUE(with("/scenario/fuel_weight", 7).ok());
  EXPECT_TRUE(absl::IsDataLoss(with("/scenario/horizon_samples", 2147483648)));
  EXPECT_TRUE(absl::IsDataLoss(with("/scenario/horizon_samples", 1.5)));
  EXPECT_TRUE(absl::IsDataLoss(with("/scenario/search/seed", -1)));
  EXPECT_TRUE(absl::IsDataLoss(with("/scenario/control_hold", "ELASTIC")));
  EXPECT_TRUE(absl::IsDataLoss(with("/scenario/search/initial_gains", Json::array({1, 2, 3, 4}))));
  EXPECT_TRUE(absl::IsDataLoss(with("/scenario/target", {{"polar", {{"r", 1}}}})));
  EXPECT_TRUE(absl::IsDataLoss(with("/scenario/colour", "red")));
}

// Nothing that a disk can make of a document throws or crashes.
TEST(Serialise, SurvivesAnyText) {
  const std::string whole = *ToJson(PlainSpec());
  for (std::size_t size = 0; size < whole.size(); ++size) {
    ASSERT_TRUE(absl::IsDataLoss(ReadSpec(whole.substr(0, size)))) << size;
  }
  std::mt19937 random(3);
  for (int i = 0; i < 5000; ++i) {
    std::string text = whole;
    for (int n = 0; n < 3; ++n) text[random() % text.size()] = static_cast<char>(random());
    const absl::Status status = ReadSpec(text);
    ASSERT_TRUE(status.ok() || absl::IsDataLoss(status)) << status;
  }
  EXPECT_TRUE(absl::IsDataLoss(ReadSpec(std::string(100'000, '['))));
  EXPECT_TRUE(absl::IsDataLoss(ReadSpec("1e999")));
}

}  // namespace
}  // namespace orbitune::storage_test
