// `orbitune verify` against a server that plays a script, and provenance as `show` and `report` print it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/cli/report_page.h"
#include "tests/client/fake_server.h"

namespace orbitune::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

v1::VerifyJobResponse Progress(int iteration) {
  v1::VerifyJobResponse message;
  message.mutable_progress()->set_last_iteration(200);
  message.mutable_progress()->set_iteration(iteration);
  return message;
}

v1::VerifyJobResponse Result(v1::Verdict verdict) {
  v1::VerifyJobResponse message;
  v1::Verification& result = *message.mutable_verification();
  result.set_verdict(verdict);
  result.set_digest("abc");
  result.set_recorded_digest("abc");
  result.set_conclusion("what came of it");
  return message;
}

TEST(VerifyCommandTest, IdenticalIsExitStatus0) {
  FakeServer server;
  server.verification = {Progress(0), Progress(120), Result(v1::VERDICT_IDENTICAL)};
  const auto result = server.Run({"verify", "a", "--from", "3", "--to", "9"});
  EXPECT_EQ(result.code, 0);
  EXPECT_EQ(result.out, "jobs/a  IDENTICAL\nwhat came of it\ndigest           abc\n");
  EXPECT_EQ(result.err, "");
  ASSERT_EQ(server.verify_requests.size(), 1u);
  EXPECT_EQ(server.verify_requests[0].name(), "jobs/a");
  EXPECT_EQ(server.verify_requests[0].first_iteration(), 3);
  EXPECT_EQ(server.verify_requests[0].last_iteration(), 9);
}

TEST(VerifyCommandTest, ADifferenceIsExitStatus1AndShownToTheLastBit) {
  FakeServer server;
  server.verification = {Result(v1::VERDICT_DIFFERENT)};
  v1::Verification& result = *server.verification[0].mutable_verification();
  result.set_recorded_digest("def");
  result.add_engine_differences("from iteration 1 on, engine version: 0.1.0 then, 0.2.0 now");
  auto& difference = *result.mutable_first_difference();
  difference.set_iteration(57);
  difference.mutable_stored()->mutable_gains()->set_k1(0.1);
  difference.mutable_stored()->set_cost(0.1 + 0.2);
  difference.mutable_recomputed()->mutable_gains()->set_k1(0.1);
  difference.mutable_recomputed()->set_cost(0.3);
  const auto run = server.Run({"verify", "jobs/a"});
  EXPECT_EQ(run.code, 1);
  EXPECT_THAT(run.out, StartsWith("jobs/a  DIFFERENT\n"));
  EXPECT_THAT(run.out, HasSubstr("\nrecorded digest  def\n"));
  EXPECT_THAT(run.out, HasSubstr("engine version: 0.1.0 then, 0.2.0 now"));
  EXPECT_THAT(run.out, HasSubstr("iteration 57"));
  EXPECT_THAT(run.out, HasSubstr("0.30000000000000004  0.3         differs"));
  EXPECT_THAT(run.out, Not(HasSubstr("K1                 0.1                  0.1         differs")));
}

TEST(VerifyCommandTest, AnAlteredOneIsExitStatus1) {
  FakeServer server;
  server.verification = {Result(v1::VERDICT_ALTERED)};
  server.verification[0].mutable_verification()->mutable_first_difference()->mutable_recomputed();
  const auto run = server.Run({"verify", "a"});
  EXPECT_EQ(run.code, 1);
  EXPECT_THAT(run.out, StartsWith("jobs/a  ALTERED\n"));
}

TEST(VerifyCommandTest, JsonIsTheVerification) {
  FakeServer server;
  server.verification = {Progress(1), Result(v1::VERDICT_IDENTICAL)};
  const auto run = server.Run({"--json", "verify", "a"});
  EXPECT_EQ(run.code, 0);
  EXPECT_THAT(run.out, StartsWith("{\"verdict\":\"VERDICT_IDENTICAL\""));
  EXPECT_EQ(std::count(run.out.begin(), run.out.end(), '\n'), 1);
}

TEST(VerifyCommandTest, ATerminalShowsTheProgress) {
  FakeServer server;
  server.verification = {Progress(120), Result(v1::VERDICT_IDENTICAL)};
  const auto run = server.Run({"verify", "a"}, 80);
  EXPECT_THAT(run.err, HasSubstr("verifying: iteration 120 of 200"));
  EXPECT_THAT(run.out, StartsWith("jobs/a  IDENTICAL\n"));
}

TEST(VerifyCommandTest, ErrorsAndAStreamThatIsCutOffAreErrors) {
  FakeServer server;
  server.verify_status = {grpc::StatusCode::NOT_FOUND, "there is no job"};
  EXPECT_EQ(server.Run({"verify", "a"}).code, 3);
  server.verify_status = grpc::Status::OK;
  server.verification = {Progress(3)};
  const auto run = server.Run({"verify", "a"});
  EXPECT_EQ(run.code, 4);
  EXPECT_THAT(run.err, HasSubstr("the stream ended before the verification did"));
  EXPECT_EQ(server.Run({"verify", "a", "--from", "x"}).code, 2);
}

v1::Job JobWithProvenance() {
  v1::Job job;
  job.set_name("jobs/a");
  job.set_state(v1::JOB_STATE_RUNNING);
  v1::Provenance& provenance = *job.mutable_provenance();
  provenance.set_scenario_digest("sss");
  provenance.set_inputs_digest("iii");
  provenance.set_digest("ddd");
  provenance.set_iterations(12);
  v1::Engine& engine = *provenance.add_engines();
  engine.set_first_iteration(1);
  engine.set_version("0.1.0");
  engine.set_simd_target("avx2");
  engine.set_fused_multiply_add(true);
  engine.set_libraries("glibc 2.36");
  return job;
}

TEST(ProvenanceTest, IsShownWithTheJob) {
  FakeServer server;
  server.jobs = {JobWithProvenance()};
  const auto run = server.Run({"show", "a"});
  EXPECT_EQ(run.code, 0);
  EXPECT_THAT(run.out, HasSubstr("digest (12 iterations)         ddd\n"));
  EXPECT_THAT(run.out,
              HasSubstr("engine (from iteration 1)      Orbitune 0.1.0, avx2, multiply-add fused, glibc 2.36\n"));
}

TEST(ProvenanceTest, IsOnTheReportsPage) {
  JobPageData data;
  data.job = JobWithProvenance();
  const std::string page = JobPage(data);
  for (const char* part : {"sss", "iii", "ddd", "history digest, 12 iterations", "Orbitune 0.1.0, avx2"}) {
    EXPECT_THAT(page, HasSubstr(part));
  }
}

}  // namespace
}  // namespace orbitune::cli
