#include "client/cli/app.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "client/cli/csv.h"
#include "client/cli/job_report.h"
#include "client/cli/parse.h"
#include "google/protobuf/util/json_util.h"
#include "tests/client/fake_server.h"

namespace orbitune::cli {
namespace {

std::string TempPath(const std::string& name) { return testing::TempDir() + std::to_string(getpid()) + "_" + name; }

std::string Contents(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

bool Has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

TEST(Usage, ErrorsAreExitCode2AndHelpIs0) {
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{},
                                             {"fly"},
                                             {"watch"},
                                             {"watch", "a", "--from", "1x"},
                                             {"submit"},
                                             {"submit", "--scenario", "a", "--scenario-file", "b"},
                                             {"submit", "--scenario", "a", "--initial-gains", "1,2,3"},
                                             {"submit", "--scenario", "a", "--label", "x"},
                                             {"submit", "--scenario", "a", "--seed", "-1"},
                                             {"submit", "--scenario", "a", "--validate-only", "--watch"},
                                             {"submit", "--scenario-file", "/no/such/file"},
                                             {"history", "a", "--format", "xml"},
                                             {"simulate"},
                                             {"simulate", "--scenario", "a", "--which", "best"},
                                             {"jobs", "--timeout", "0"}}) {
    const FakeServer::Result result = RunClient(arguments);
    EXPECT_EQ(result.code, 2) << testing::PrintToString(arguments);
    EXPECT_EQ(result.err.rfind("orbitune: INVALID_ARGUMENT: ", 0), 0u) << result.err;
  }
  EXPECT_EQ(RunClient({"--version"}).out.rfind("orbitune ", 0), 0u);
  EXPECT_TRUE(Has(RunClient({"--help"}).out, "Exit codes"));
  EXPECT_EQ(RunClient({"submit", "--help"}).code, 0);
  EXPECT_EQ(RunClient({"--json", "fly"}).err.rfind("{\"error\":", 0), 0u);
}

TEST(Usage, UnreachableServer) {
  const FakeServer::Result result = RunClient({"--server", "127.0.0.1:1", "jobs"});
  EXPECT_EQ(result.code, 4);
  EXPECT_TRUE(Has(result.err, "server: 127.0.0.1:1")) << result.err;
}

TEST(Submit, SendsWhatWasGivenAndNothingElse) {
  FakeServer server;
  const FakeServer::Result result = server.Run({"submit",
                                                "--scenario",
                                                "gto-geo",
                                                "--name",
                                                "first",
                                                "--label",
                                                "a=1",
                                                "--label",
                                                "b=x=y",
                                                "--priority",
                                                "-2",
                                                "--iterations",
                                                "10",
                                                "--step-size",
                                                "0.1",
                                                "--initial-gains",
                                                "1,2,3,4,5",
                                                "--seed",
                                                "7",
                                                "--ic",
                                                "x_km=1,y_km=2,z_km=3,x_dot_km_s=4,y_dot_km_s=5,z_dot_km_s=6"});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_TRUE(Has(result.out, "jobs/new  QUEUED\nwatch it with: orbitune --server 127.0.0.1:")) << result.out;
  v1::Job expected;
  ASSERT_TRUE(
      google::protobuf::util::JsonStringToMessage(
          R"({"display_name": "first", "labels": {"a": "1", "b": "x=y"}, "priority": -2, "scenario": "scenarios/gto-geo",
                      "initial_condition": {"cartesian": {"x_km": 1, "y_km": 2, "z_km": 3, "x_dot_km_s": 4,
                                                          "y_dot_km_s": 5, "z_dot_km_s": 6}},
                      "hyperparameters": {"iterations": 10, "step_size": 0.1, "seed": 7,
                                          "initial_gains": {"k1": 1, "k2": 2, "k3": 3, "k4": 4, "k5": 5}}})",
          &expected)
          .ok());
  EXPECT_EQ(server.create_requests[0].job().DebugString(), expected.DebugString());
  EXPECT_EQ(server.create_requests[0].request_id().size(), 36u);
  server.Run({"submit", "--scenario", "gto-geo", "--request-id", "mine", "--validate-only"});
  EXPECT_EQ(server.create_requests[1].request_id(), "mine");
  EXPECT_TRUE(server.create_requests[1].validate_only());
}

TEST(Submit, ChoosesAndShapesTheSearch) {
  FakeServer server;
  const std::string ics = TempPath("ics.csv");
  std::ofstream(ics) << "p_km,ex,ey,hx,hy,true_longitude_deg\n7000,0,0,0.1,0,10\n7001,0,0,0.1,0,11\n";
  ASSERT_EQ(server
                .Run({"submit",
                      "--scenario",
                      "leo-rendezvous",
                      "--algorithm",
                      "cma-es",
                      "--population",
                      "32",
                      "--initial-sigma",
                      "0.5",
                      "--restarts",
                      "2",
                      "--population-growth",
                      "2",
                      "--max-episodes",
                      "9000",
                      "--plateau",
                      "50",
                      "--plateau-improvement",
                      "0.01",
                      "--ics",
                      ics,
                      "--objective",
                      "cvar:0.9",
                      "--relative",
                      "--warm-start",
                      "jobs/abc"})
                .code,
            0);
  const v1::Job& job = server.create_requests.at(0).job();
  const v1::Hyperparameters& h = job.hyperparameters();
  EXPECT_EQ(h.algorithm(), v1::ALGORITHM_CMA_ES);
  EXPECT_EQ(h.cma_es().population(), 32);
  EXPECT_EQ(h.cma_es().initial_sigma(), 0.5);
  EXPECT_EQ(h.cma_es().restarts(), 2);
  EXPECT_EQ(h.cma_es().population_growth(), 2);
  EXPECT_FALSE(h.has_nelder_mead());
  EXPECT_EQ(h.max_episodes(), 9000);
  EXPECT_EQ(h.plateau_stop().iterations(), 50);
  EXPECT_EQ(h.plateau_stop().min_improvement(), 0.01);
  EXPECT_FALSE(h.has_iterations());
  ASSERT_EQ(job.initial_conditions_size(), 2);
  EXPECT_EQ(job.initial_conditions(1).equinoctial().p_km(), 7001);
  EXPECT_EQ(job.objective().aggregate(), v1::AGGREGATE_CVAR);
  EXPECT_EQ(job.objective().level(), 0.9);
  EXPECT_TRUE(job.objective().relative_to_initial());
  EXPECT_EQ(job.warm_start(), "jobs/abc");

  ASSERT_EQ(server
                .Run({"submit", "--scenario", "gto-geo", "--top-directions", "4", "--step-schedule", "inverse-sqrt",
                      "--exploration-schedule", "linear", "--log-gains"})
                .code,
            0);
  const v1::ArsVariants& ars = server.create_requests.at(1).job().hyperparameters().ars_variants();
  EXPECT_EQ(ars.top_directions(), 4);
  EXPECT_EQ(ars.step_schedule(), v1::SCHEDULE_INVERSE_SQRT);
  EXPECT_EQ(ars.exploration_schedule(), v1::SCHEDULE_LINEAR);
  EXPECT_TRUE(ars.log_gains());

  ASSERT_EQ(server
                .Run({"submit", "--scenario", "gto-geo", "--algorithm", "nelder-mead", "--initial-step", "0.2",
                      "--restarts", "5"})
                .code,
            0);
  EXPECT_EQ(server.create_requests.at(2).job().hyperparameters().nelder_mead().restarts(), 5);
  EXPECT_FALSE(server.create_requests.at(2).job().hyperparameters().has_cma_es());

  const auto error = [&](const std::vector<std::string>& flags) {
    std::vector<std::string> arguments = {"submit", "--scenario", "gto-geo"};
    arguments.insert(arguments.end(), flags.begin(), flags.end());
    const FakeServer::Result result = server.Run(arguments);
    EXPECT_EQ(result.code, 2);
    return result.err;
  };
  EXPECT_TRUE(Has(error({"--algorithm", "genetic"}), "--algorithm: must be ars, cma-es or nelder-mead, got 'genetic'"));
  EXPECT_TRUE(Has(error({"--step-schedule", "cubic"}), "--step-schedule: must be constant, linear or inverse-sqrt"));
  EXPECT_TRUE(Has(error({"--ics", ics, "--objective", "cvar"}), "--objective: must be mean, worst, percentile:LEVEL"));
  EXPECT_TRUE(Has(error({"--objective", "mean"}), "--ics"));
  EXPECT_TRUE(Has(error({"--warm-start", "jobs/a", "--initial-gains", "1,1,1,1,1"}), "--initial-gains"));
}

// What a job's search is not, `show` leaves out.
TEST(Show, TellsTheSearchThatIsUsed) {
  FakeServer server;
  v1::Job job;
  job.set_name("jobs/a");
  job.set_state(v1::JOB_STATE_RUNNING);
  job.set_warm_start("jobs/b");
  job.add_initial_conditions()->mutable_equinoctial()->set_p_km(1);
  job.add_initial_conditions();
  job.mutable_objective()->set_aggregate(v1::AGGREGATE_WORST);
  v1::Hyperparameters& h = *job.mutable_hyperparameters();
  h.set_algorithm(v1::ALGORITHM_CMA_ES);
  h.set_directions(16);
  h.set_iterations(5000);
  h.set_max_episodes(6000);
  h.mutable_cma_es()->set_population(16);
  h.mutable_nelder_mead()->set_restarts(3);
  job.set_completed_iterations(100);
  job.mutable_latest_iteration()->set_episodes(1500);
  server.jobs = {job};
  const std::string out = server.Run({"show", "a"}).out;
  EXPECT_TRUE(Has(out, "ALGORITHM_CMA_ES")) << out;
  EXPECT_TRUE(Has(out, "population"));
  EXPECT_TRUE(Has(out, "100/400")) << out;  // the budget ends it before its iterations
  EXPECT_TRUE(Has(out, "AGGREGATE_WORST"));
  EXPECT_TRUE(Has(out, "jobs/b"));
  EXPECT_FALSE(Has(out, "directions"));
  EXPECT_FALSE(Has(out, "nelder_mead"));
}

TEST(Submit, RefusalsKeepTheirCode) {
  FakeServer server;
  server.create_status = {grpc::StatusCode::ALREADY_EXISTS, "another job has this request_id"};
  const FakeServer::Result result = server.Run({"submit", "--scenario", "gto-geo", "--request-id", "x"});
  EXPECT_EQ(result.code, 5);
  EXPECT_EQ(result.err, "orbitune: ALREADY_EXISTS: another job has this request_id\n");
}

TEST(Scenarios, JsonOutputIsAFileToSubmit) {
  FakeServer server;
  server.scenario.set_name("scenarios/gto-geo");
  server.scenario.set_sampling_period_s(2700);
  server.scenario.mutable_target()->mutable_keplerian()->set_true_longitude_deg(0.1 + 0.2);
  server.scenario.mutable_hyperparameters()->set_seed(UINT64_MAX);
  const FakeServer::Result shown = server.Run({"scenarios", "gto-geo", "--json"});
  ASSERT_EQ(shown.code, 0) << shown.err;
  const std::string path = TempPath("scenario.json");
  std::ofstream(path) << shown.out;
  EXPECT_EQ(server.Run({"submit", "--scenario-file", path}).code, 0);
  const v1::Job& job = server.create_requests[0].job();
  EXPECT_EQ(job.scenario_definition().SerializeAsString(), server.scenario.SerializeAsString());
  EXPECT_EQ(job.scenario(), "");

  std::ofstream(path) << R"({"sampling_period_min": 45})";
  const FakeServer::Result bad = server.Run({"submit", "--scenario-file", path});
  EXPECT_EQ(bad.code, 2);
  EXPECT_TRUE(Has(bad.err, path) && Has(bad.err, "sampling_period_min")) << bad.err;
  std::filesystem::remove(path);
  EXPECT_EQ(server.Run({"scenarios", "none"}).code, 3);
}

TEST(Jobs, PagesThroughEverythingUpToTheLimit) {
  FakeServer server;
  for (int i = 0; i < 2500; ++i) server.jobs.emplace_back().set_name("jobs/" + std::to_string(i));
  const auto lines = [](const std::string& text) { return std::count(text.begin(), text.end(), '\n'); };
  EXPECT_EQ(lines(server.Run({"jobs"}).out), 2501);
  EXPECT_EQ(lines(server.Run({"--json", "jobs"}).out), 2500);
  EXPECT_EQ(lines(server.Run({"jobs", "--limit", "1200"}).out), 1201);
  EXPECT_EQ(server.list_requests.back().page_size(), 200);
  server.Run(
      {"jobs", "--filter", "create_time > 5", "--state", "running", "--label", "k=a\"b", "--scenario", "gto-geo"});
  EXPECT_EQ(server.list_requests.back().filter(),
            R"(create_time > 5 AND state = RUNNING AND scenario = "gto-geo" AND labels.k = "a\"b")");
}

TEST(Jobs, TransitionsTryEachAndTellTheFirstFailure) {
  FakeServer server;
  server.jobs.resize(2);
  server.jobs[0].set_name("jobs/a");
  server.jobs[1].set_name("jobs/b");
  server.jobs[1].set_state(v1::JOB_STATE_SUCCEEDED);
  const FakeServer::Result result = server.Run({"cancel", "b", "none", "jobs/a"});
  EXPECT_EQ(result.code, 5);
  EXPECT_EQ(result.out, "jobs/a  CANCELLED\n");
  EXPECT_TRUE(Has(result.err, "NOT_FOUND: no jobs/none")) << result.err;
}

TEST(History, PagesInOrderIntoAWholeFile) {
  FakeServer server;
  for (int i = 1; i <= 10001; ++i) server.iterations.emplace_back().set_iteration(i);
  std::string expected = IterationCsvHeader() + "\n";
  for (const auto& iteration : server.iterations) expected += IterationCsvRow(iteration) + "\n";
  EXPECT_EQ(server.Run({"history", "a"}).out, expected);
  ASSERT_EQ(server.iteration_requests.size(), 2u);
  EXPECT_EQ(server.iteration_requests[0].parent(), "jobs/a");
  EXPECT_EQ(server.iteration_requests[0].page_size(), 10000);

  const std::filesystem::path folder = TempPath("history");
  std::filesystem::create_directory(folder);
  EXPECT_EQ(server.Run({"history", "a", "-o", folder / "h.csv"}).code, 0);
  EXPECT_EQ(Contents(folder / "h.csv"), expected);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder), {}), 1);  // nothing temporary stays
  EXPECT_EQ(server.Run({"history", "a", "-o", folder / "no" / "h.csv"}).code, 2);
  EXPECT_EQ(server.Run({"history", "a", "-o", "/dev/null"}).code, 0);
  EXPECT_TRUE(std::filesystem::is_character_file("/dev/null"));
  std::filesystem::remove_all(folder);
}

TEST(Simulate, OfAJobTakesWhatItFlies) {
  FakeServer server;
  v1::Job& job = server.jobs.emplace_back();
  job.set_name("jobs/a");
  job.mutable_scenario_definition()->set_fuel_weight(50);
  job.mutable_initial_condition()->mutable_keplerian()->set_semi_major_axis_km(7000);
  *job.mutable_best_iteration()->mutable_gains() = *ParseGains("1,2,3,4,5");
  server.episode.mutable_result()->set_cost(640.5);
  server.episode.mutable_result()->set_outcome(v1::OUTCOME_SETTLED);
  server.episode.add_trajectory()->set_sample(3);
  const FakeServer::Result result = server.Run({"simulate", "--job", "a", "--csv", "-", "--stride", "10"});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.out, TrajectoryCsvHeader() + "\n" + TrajectoryCsvRow(server.episode.trajectory(0)) + "\n");
  EXPECT_TRUE(Has(result.err, "640.5")) << result.err;
  const v1::SimulateEpisodeRequest& request = server.simulate_requests[0];
  EXPECT_EQ(request.scenario_definition().fuel_weight(), 50);
  EXPECT_EQ(request.initial_condition().keplerian().semi_major_axis_km(), 7000);
  EXPECT_EQ(request.gains().k5(), 5);
  EXPECT_TRUE(request.include_trajectory());
  EXPECT_EQ(request.sample_stride(), 10);
  EXPECT_EQ(server.Run({"simulate", "--job", "a", "--which", "final"}).code, 5);  // none yet
}

TEST(Simulate, LeavingTheDomainIsToldAndExitCode1) {
  FakeServer server;
  server.episode.mutable_result()->set_outcome(v1::OUTCOME_LEFT_DOMAIN);
  server.episode.mutable_result()->set_outcome_message("angular momentum reached 0 at 123 s");
  const FakeServer::Result result = server.Run({"simulate", "--scenario", "gto-geo-printed"});
  EXPECT_EQ(result.code, 1);
  EXPECT_TRUE(Has(result.out, "left the domain") && Has(result.out, "angular momentum reached 0")) << result.out;
  EXPECT_FALSE(Has(result.out, "cost J"));
}

TEST(Summary, TellsBeforeAndAfter) {
  v1::Job job;
  ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(
                  R"({"name": "jobs/a", "state": "JOB_STATE_SUCCEEDED", "completed_iterations": 2000,
      "start_time": "2024-05-01T12:00:00Z", "end_time": "2024-05-01T12:00:12.500Z",
      "hyperparameters": {"iterations": 2000}, "report": {"episodes": 66000,
      "initial": {"iteration": 1, "gains": {"k1": 0.1}, "result": {"outcome": "OUTCOME_SETTLED", "cost": 812.628,
        "settling_samples": 700, "settling_time_s": 1890000, "domain_guarantee": "DOMAIN_GUARANTEE_NOT_GUARANTEED"}},
      "final": {"iteration": 2000, "gains": {"k1": 0.5}, "result": {"outcome": "OUTCOME_SETTLED", "cost": 142.5,
        "settling_samples": 96, "peak_acceleration_m_s2": 0.25, "domain_guarantee": "DOMAIN_GUARANTEE_GUARANTEED"}},
      "best": {"iteration": 1377, "result": {"outcome": "OUTCOME_LEFT_DOMAIN"}},
      "final_reduction": {"cost_percent": 82.46, "delta_v_percent": -3},
      "warnings": [{"message": "k2 is at its floor"}]}})",
                  &job)
                  .ok());
  std::ostringstream out;
  PrintJobSummary(job, out);
  for (const char* part : {"66000 episodes, elapsed 12.5 s", "K(1)      0.1 0 0 0 0", "K(2000)   0.5",
                           "(iteration 1377)", "812.628", "142.5", "82.5 %", "525", "-3.0 %", "0.25", "left the domain",
                           "not guaranteed", "warning: k2 is at its floor\n"}) {
    EXPECT_TRUE(Has(out.str(), part)) << part << " is not in\n" << out.str();
  }
}

}  // namespace
}  // namespace orbitune::cli
