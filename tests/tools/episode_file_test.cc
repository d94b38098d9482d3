#include "tests/tools/episode_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>

namespace orbitune {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

json ReferenceFile() {
  std::ifstream file(ORBITUNE_REFERENCE_FILE);
  return json::parse(file);
}

// A file of one case: the first of the reference file, changed.
template <typename Change>
std::string OneCase(const Change& change) {
  json object = ReferenceFile()[0];
  change(object);
  return json::array({object}).dump();
}

std::string ErrorOf(std::string_view text) {
  const auto parsed = ParseEpisodeFile(text);
  EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument) << text;
  return std::string(parsed.status().message());
}

json RunOne(const std::string& text) {
  const auto parsed = ParseEpisodeFile(text);
  EXPECT_TRUE(parsed.ok()) << parsed.status();
  // Through text, as the tool's readers see it: a NaN has become a null.
  return parsed.ok() ? json::parse(RunEpisode(parsed->at(0)).dump()) : json();
}

struct ProgramRun {
  int exit_status = -1;
  std::string output;  // stdout and stderr
};

ProgramRun RunProgram(const std::string& arguments) {
  ProgramRun run;
  FILE* pipe = popen((std::string(ORBITUNE_EPISODES_PROGRAM) + " " + arguments + " 2>&1").c_str(), "r");
  if (pipe == nullptr) return run;
  char buffer[4096];
  while (const std::size_t n = std::fread(buffer, 1, sizeof buffer, pipe)) run.output.append(buffer, n);
  const int status = pclose(pipe);
  run.exit_status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return run;
}

TEST(OrbituneEpisodesTest, ReproducesTheReferenceFile) {
  const ProgramRun run = RunProgram(ORBITUNE_REFERENCE_FILE);
  ASSERT_EQ(run.exit_status, 0) << run.output;
  const json results = json::parse(run.output);
  const json cases = ReferenceFile();
  ASSERT_EQ(results.size(), cases.size());
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const json &result = results[i], &expected = cases[i]["expected"];
    SCOPED_TRACE(cases[i]["name"]);
    EXPECT_EQ(result["name"], cases[i]["name"]);
    EXPECT_EQ(result["outcome"], "settled");
    EXPECT_EQ(result["settling_samples"], expected["settling_samples"]);
    for (const char* field : {"fuel_sum", "cost", "delta_v_to_settling_m_s"}) {
      EXPECT_NEAR(result[field].get<double>() / expected[field].get<double>(), 1, 1e-6) << field;
    }
    for (const char* field : {"distance_km", "control_norm"}) {
      ASSERT_EQ(result[field].size(), expected[field].size());
      for (const auto& [sample, value] : expected[field].items()) {
        ASSERT_TRUE(result[field].contains(sample));
        // The last digits of a state that has all but settled are the integrator's business.
        EXPECT_NEAR(result[field][sample].get<double>(), value.get<double>(), 1e-6 * value.get<double>() + 1e-9)
            << field << " at " << sample;
      }
    }
  }
}

TEST(OrbituneEpisodesTest, ExitsWithTwoOnBadInput) {
  EXPECT_EQ(RunProgram("").exit_status, 2);
  EXPECT_EQ(RunProgram("a b").exit_status, 2);
  const ProgramRun missing = RunProgram("/nonexistent/file.json");
  EXPECT_EQ(missing.exit_status, 2);
  EXPECT_EQ(missing.output, "orbitune_episodes: /nonexistent/file.json: cannot be read\n");
  const ProgramRun directory = RunProgram("/");
  EXPECT_EQ(directory.exit_status, 2);
  const ProgramRun itself = RunProgram(ORBITUNE_EPISODES_PROGRAM);
  EXPECT_EQ(itself.exit_status, 2);
  EXPECT_THAT(itself.output, HasSubstr("not JSON"));
}

TEST(EpisodeFileTest, WithoutExpectedThereAreNoSamples) {
  for (const bool null : {false, true}) {
    const json result = RunOne(OneCase([null](json& c) {
      c.erase("expected");
      if (null) c["expected"] = nullptr;
    }));
    EXPECT_EQ(result["settling_samples"], 343);
    EXPECT_EQ(result["distance_km"], json::object());
    EXPECT_EQ(result["control_norm"], json::object());
  }
}

TEST(EpisodeFileTest, SamplesReachToTheHorizonAndNoFarther) {
  const json result = RunOne(OneCase([](json& c) {
    c["expected"]["distance_km"] = {{"0", 0}, {"1279", 0}, {"1280", 0}, {"1281", 0}};
    c["expected"].erase("control_norm");
  }));
  EXPECT_GT(result["distance_km"]["0"], 39226);
  EXPECT_LT(result["distance_km"]["1280"], 1e-3);
  EXPECT_GT(result["distance_km"]["1280"], 0);
  EXPECT_TRUE(result["distance_km"]["1281"].is_null());
  EXPECT_EQ(result["control_norm"], json::object());
}

TEST(EpisodeFileTest, NotSettledHasACost) {
  const json result = RunOne(OneCase([](json& c) { c["horizon_samples"] = 20; }));
  EXPECT_EQ(result["outcome"], "not_settled");
  EXPECT_EQ(result["settling_samples"], 20);
  EXPECT_NEAR(result["cost"].get<double>(), 20 + 50 * result["fuel_sum"].get<double>(), 1e-9);
  EXPECT_GT(result["delta_v_to_settling_m_s"], 0);
}

TEST(EpisodeFileTest, LeftDomainHasNone) {
  // The orbit of gto-geo-printed: the longitude of periapsis mirrored.
  const json result = RunOne(OneCase([](json& c) { c["chaser"]["ey"] = -c["chaser"]["ey"].get<double>(); }));
  EXPECT_EQ(result["outcome"], "left_domain");
  for (const char* field : {"settling_samples", "fuel_sum", "cost", "delta_v_to_settling_m_s"}) {
    EXPECT_TRUE(result[field].is_null()) << field;
  }
  EXPECT_TRUE(result["distance_km"]["0"].is_number());
  EXPECT_TRUE(result["distance_km"]["200"].is_null());
}

TEST(EpisodeFileTest, NumericalFailureIsNamed) {
  const json result = RunOne(OneCase([](json& c) {
    c["gains"][4] = 1e6;  // stiff: some 45,000 steps a sample
    c["horizon_samples"] = 4;
  }));
  EXPECT_EQ(result["outcome"], "numerical_failure");
  EXPECT_TRUE(result["cost"].is_null());
}

TEST(EpisodeFileTest, ErrorsNameTheCaseAndTheField) {
  EXPECT_THAT(ErrorOf(""), HasSubstr("not JSON"));
  EXPECT_THAT(ErrorOf("[{]"), HasSubstr("not JSON"));
  EXPECT_EQ(ErrorOf("{}"), "must be an array of cases");
  EXPECT_THAT(ErrorOf("[3]"), HasSubstr("case 1: : must be an object, got \"3\""));
  EXPECT_THAT(ErrorOf("[{}]"), HasSubstr("name: must be given, got nothing; gains: must be given"));
  EXPECT_EQ(ErrorOf(OneCase([](json& c) { c.erase("fuel_weight"); })),
            "case 1 (\"gto-geo initial gains\"): fuel_weight: must be given, got nothing");
  EXPECT_THAT(ErrorOf(OneCase([](json& c) { c["target"]["p_km"] = -1; })),
              HasSubstr("target.p_km: must be > 0 and finite, got -1"));
  EXPECT_THAT(ErrorOf(OneCase([](json& c) { c["chaser"]["hx"] = "north"; })), HasSubstr("chaser.hx: must be a number"));
  EXPECT_THAT(ErrorOf(OneCase([](json& c) { c["chaser"] = json::array(); })),
              HasSubstr("chaser: must be an object, got \"[]\""));
  EXPECT_THAT(ErrorOf(OneCase([](json& c) { c["tolerance_km"] = 0; })), HasSubstr("tolerance_km: must be > 0"));
  EXPECT_THAT(ErrorOf(OneCase([](json& c) { c["mu_km3_s2"] = -3; })), HasSubstr("mu_km3_s2: must be > 0"));
  EXPECT_THAT(ErrorOf(OneCase([](json& c) { c["horizon_samples"] = 2.5; })),
              HasSubstr("horizon_samples: must be a whole number"));
  EXPECT_THAT(ErrorOf(OneCase([](json& c) { c["horizon_samples"] = 1e18; })),
              HasSubstr("horizon_samples: must be a whole number"));
  EXPECT_THAT(ErrorOf(OneCase([](json& c) { c["gains"] = {1, 2, 3}; })), HasSubstr("gains: must be an array of 5"));
  EXPECT_THAT(ErrorOf(OneCase([](json& c) { c["gains"][2] = 0; })), HasSubstr("gains[2]: must be a number > 0"));
  EXPECT_THAT(ErrorOf(OneCase([](json& c) { c["expected"] = 7; })), HasSubstr("expected: must be an object"));
  EXPECT_THAT(ErrorOf(OneCase([](json& c) {
                c["expected"]["distance_km"] = {{"-1", 0}};
              })),
              HasSubstr("expected.distance_km: must be keyed by sample numbers >= 0, got \"-1\""));
  EXPECT_THAT(ErrorOf(OneCase([](json& c) { c["expected"]["control_norm"] = 1; })),
              HasSubstr("expected.control_norm: must be an object"));
}

}  // namespace
}  // namespace orbitune
