// VerifyJob over gRPC and HTTP, and provenance as clients see it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <condition_variable>
#include <mutex>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/library/history_digest.h"
#include "server/convert/job.h"
#include "storage/sqlite_connection.h"
#include "tests/server/rest_support.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

// A VerifyJob call.
class VerifyCall {
 public:
  VerifyCall(Client& client, const std::string& name, int first = 0, int last = 0) {
    v1::VerifyJobRequest request;
    request.set_name(name);
    request.set_first_iteration(first);
    request.set_last_iteration(last);
    reader_ = client.tuning().VerifyJob(&context_, request);
  }

  grpc::Status ReadAll(std::vector<v1::VerifyJobResponse>* messages) {
    v1::VerifyJobResponse message;
    while (reader_->Read(&message)) messages->push_back(message);
    return reader_->Finish();
  }
  grpc::Status Finish() {
    std::vector<v1::VerifyJobResponse> ignored;
    return ReadAll(&ignored);
  }

 private:
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReader<v1::VerifyJobResponse>> reader_;
};

// Keeps all threads that verify busy, and `waiting` more tasks before anything new, until it goes.
class Occupied {
 public:
  Occupied(Executor& executor, int threads, int waiting) {
    const auto wait = [this] {
      std::unique_lock lock(mutex_);
      ++begun_;
      changed_.notify_all();
      changed_.wait(lock, [this] { return over_; });
      ++ended_;
      changed_.notify_all();
    };
    tasks_ = threads + waiting;
    for (int i = 0; i < threads; ++i) executor.Post(wait);
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return begun_ == threads; });
    lock.unlock();
    for (int i = 0; i < waiting; ++i) executor.Post(wait);
  }
  ~Occupied() {
    std::unique_lock lock(mutex_);
    over_ = true;
    changed_.notify_all();
    changed_.wait(lock, [this] { return ended_ == tasks_; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  int tasks_ = 0;
  int begun_ = 0;
  int ended_ = 0;
  bool over_ = false;
};

constexpr int kThreads = 2;
constexpr int kMostWaiting = 16;

class VerifyApiTest : public RpcServerTest {
 protected:
  VerifyApiTest() : RpcServerTest({.calls = {.max_calls_waiting = kMostWaiting}}) {
    HttpOptions options;
    options.address = "127.0.0.1:0";
    auto http = HttpServer::Start(std::move(options), api_);
    EXPECT_TRUE(http.ok()) << http.status();
    http_ = *std::move(http);
  }
  ~VerifyApiTest() override { http_->Shutdown(std::chrono::seconds(2)); }

  std::string Run(int iterations) {
    const std::string name = client_->Create(iterations);
    EXPECT_EQ(client_->WaitForEnd(name).state(), v1::JOB_STATE_SUCCEEDED);
    return name;
  }

  void Alter(const std::string& sql) {
    auto connection = Connection::Open(directory_.File("jobs.db"), Connection::Mode::kReadWrite);
    ASSERT_TRUE(connection.ok());
    const absl::Status status = (*connection)->Execute(sql);
    ASSERT_TRUE(status.ok()) << status;
  }

  std::unique_ptr<HttpServer> http_;
};

TEST_F(VerifyApiTest, ProgressThenTheVerificationThenOk) {
  const std::string name = Run(30);
  const v1::Provenance provenance = client_->Get(name).provenance();
  std::vector<v1::VerifyJobResponse> messages;
  const grpc::Status status = VerifyCall(*client_, name).ReadAll(&messages);
  EXPECT_TRUE(status.ok()) << status.error_message();
  ASSERT_FALSE(messages.empty());
  ASSERT_TRUE(messages.back().has_verification());
  for (std::size_t i = 0; i + 1 < messages.size(); ++i) EXPECT_TRUE(messages[i].has_progress());
  const v1::Verification& result = messages.back().verification();
  EXPECT_EQ(result.verdict(), v1::VERDICT_IDENTICAL) << result.conclusion();
  EXPECT_EQ(result.completed_iterations(), 30);
  EXPECT_EQ(result.digest(), provenance.digest());
  EXPECT_EQ(result.recorded_digest(), provenance.digest());
  EXPECT_THAT(result.conclusion(), StartsWith("iterations 1 to 30 come out the same"));
}

TEST_F(VerifyApiTest, AnAlteredIterationIsShownWithWhatItShouldBe) {
  const std::string name = Run(8);
  Alter("UPDATE iterations SET k2 = k2 * 1.25 WHERE iteration = 5");
  std::vector<v1::VerifyJobResponse> messages;
  EXPECT_TRUE(VerifyCall(*client_, name).ReadAll(&messages).ok());
  const v1::Verification& result = messages.back().verification();
  EXPECT_EQ(result.verdict(), v1::VERDICT_ALTERED);
  EXPECT_NE(result.digest(), result.recorded_digest());
  const auto& difference = result.first_difference();
  EXPECT_EQ(difference.iteration(), 5);
  EXPECT_EQ(difference.stored().gains().k2(), difference.recomputed().gains().k2() * 1.25);
  EXPECT_EQ(difference.stored().gains().k1(), difference.recomputed().gains().k1());
}

TEST_F(VerifyApiTest, WhatCannotBeVerifiedIsRefusedNamingTheField) {
  const std::string name = Run(3);
  const auto field_of = [&](const std::string& job, int first, int last) {
    const grpc::Status status = VerifyCall(*client_, job, first, last).Finish();
    const auto violations = DetailsOf(status).violations;
    return violations.empty() ? status.error_message() : violations[0].field();
  };
  EXPECT_EQ(field_of("nonsense", 0, 0), "name");
  EXPECT_EQ(field_of(name, 4, 0), "first_iteration");
  EXPECT_EQ(field_of(name, 2, 1), "last_iteration");
  EXPECT_EQ(VerifyCall(*client_, "jobs/none").Finish().error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(VerifyApiTest, OverHttpAsEventsAndAsLines) {
  const std::string name = Run(6);
  for (const bool sse : {true, false}) {
    EventStream stream(http_->address(), "/v1/" + name + ":verify?first_iteration=4", sse);
    EXPECT_EQ(stream.head().code, 200);
    const std::vector<StreamEvent> events = stream.ReadAll();
    EXPECT_TRUE(stream.ended_well());
    ASSERT_FALSE(events.empty());
    if (sse) {
      EXPECT_EQ(events.back().kind, "verification");
    }
    EXPECT_THAT(events.back().json, HasSubstr("\"verdict\":\"VERDICT_IDENTICAL\""));
    EXPECT_THAT(events.back().json, HasSubstr("\"first_iteration\":3"));
  }
  EXPECT_EQ(HttpClient(http_->address()).Get("/v1/jobs/none:verify").code, 404);
  EXPECT_EQ(HttpClient(http_->address()).Get("/v1/" + name + ":verify?last_iteration=9").code, 400);
  // A browser's EventSource that connects again is not to start it again.
  EXPECT_EQ(HttpClient(http_->address()).Get("/v1/" + name + ":verify", "Last-Event-ID: 0\r\n").code, 400);
}

TEST_F(VerifyApiTest, TooManyAreRefusedAndNobodyElseWaits) {
  const std::string name = Run(3);
  {
    const Occupied occupied(api_.executors().For(Work::kVerify), kThreads, kMostWaiting);
    const grpc::Status status = VerifyCall(*client_, name).Finish();
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_TRUE(DetailsOf(status).retry);
    EXPECT_EQ(client_->Get(name).state(), v1::JOB_STATE_SUCCEEDED);
    EXPECT_EQ(client_->WaitForEnd(client_->Create(3)).state(), v1::JOB_STATE_SUCCEEDED);
  }
  EXPECT_TRUE(VerifyCall(*client_, name).Finish().ok());
}

TEST_F(VerifyApiTest, OneThatWaitsEndsWithItsDeadlineAndWithTheServer) {
  const std::string name = Run(3);
  const Occupied occupied(api_.executors().For(Work::kVerify), kThreads, 0);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(100));
  v1::VerifyJobRequest request;
  request.set_name(name);
  const auto reader = client_->tuning().VerifyJob(&context, request);
  EXPECT_EQ(reader->Finish().error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
  VerifyCall waiting(*client_, name);
  client_->Get(name);  // by then the call has reached the server
  api_.Drain();
  EXPECT_EQ(waiting.Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
}

// The lines that the JSON form of a message gives, as docs/api.md makes them.
class JsonLines {
 public:
  void Add(const google::protobuf::Message& message, const std::string& path) {
    const auto* descriptor = message.GetDescriptor();
    for (int i = 0; i < descriptor->field_count(); ++i) {
      const Field& field = *descriptor->field(i);
      const auto* reflection = message.GetReflection();
      const std::string name = absl::StrCat(path, ".", field.name());
      ASSERT_FALSE(field.is_repeated()) << name;
      if (field.has_presence() && !reflection->HasField(message, &field)) continue;
      if (field.cpp_type() == Field::CPPTYPE_MESSAGE) {
        Add(reflection->GetMessage(message, &field), name);
      } else {
        lines_.push_back(absl::StrCat(name, "=", Value(message, field), "\n"));
      }
    }
  }

  std::vector<std::string> lines_;

 private:
  using Field = google::protobuf::FieldDescriptor;

  static std::string Bits(double value) { return absl::StrFormat("%016x", std::bit_cast<std::uint64_t>(value)); }

  static std::string Value(const google::protobuf::Message& message, const Field& field) {
    const auto* reflection = message.GetReflection();
    switch (field.cpp_type()) {
      case Field::CPPTYPE_DOUBLE:
        return Bits(reflection->GetDouble(message, &field));
      case Field::CPPTYPE_INT32:
        return Bits(reflection->GetInt32(message, &field));
      case Field::CPPTYPE_INT64:
        return absl::StrCat(reflection->GetInt64(message, &field));
      case Field::CPPTYPE_UINT64:
        return absl::StrCat(reflection->GetUInt64(message, &field));
      case Field::CPPTYPE_BOOL:
        return reflection->GetBool(message, &field) ? "true" : "false";
      case Field::CPPTYPE_ENUM:
        return reflection->GetEnum(message, &field)->name();
      default:
        return reflection->GetString(message, &field);
    }
  }
};

// Every field that the API has, and any that it will have: one that is not in the digest shows here.
void ExpectAllInputsInDigest(const JobSpec& spec) {
  v1::Job job;
  JobRecord record;
  record.spec = spec;
  ToProto(record, &job);
  v1::Scenario scenario = job.scenario_definition();
  scenario.clear_chaser();
  scenario.clear_hyperparameters();
  scenario.clear_initial_condition_distribution();
  JsonLines json;
  json.Add(scenario, "scenario_definition");
  std::erase_if(json.lines_, [](const std::string& line) {
    return line.starts_with("scenario_definition.name=") || line.starts_with("scenario_definition.display_name=") ||
           line.starts_with("scenario_definition.description=");
  });
  json.Add(job.hyperparameters(), "hyperparameters");
  if (job.has_initial_condition()) json.Add(job.initial_condition(), "initial_condition");
  for (int i = 0; i < job.initial_conditions_size(); ++i) {
    json.Add(job.initial_conditions(i), absl::StrCat("initial_conditions[", i, "]"));
  }
  if (job.has_objective()) json.Add(job.objective(), "objective");
  json.lines_.push_back("scenario_digest=abc\n");
  std::ranges::sort(json.lines_);
  std::string expected = "orbitune job 1\n";
  for (const std::string& line : json.lines_) expected += line;
  EXPECT_EQ(InputsText("abc", spec.scenario, spec.initial_condition, spec.initial_conditions, spec.objective),
            expected);
}

TEST(InputsDigestTest, HasEveryInputOfTheApi) {
  JobSpec spec = SpecOf(SmallScenario());
  ExpectAllInputsInDigest(spec);
  spec.scenario.control_hold = ControlHold::kZeroOrder;
  spec.scenario.search.algorithm = Algorithm::kCmaEs;
  spec.scenario.search.ars_variants.log_gains = true;
  spec.scenario.search.ars_variants.step_schedule = Schedule::kInverseSqrt;
  spec.initial_condition = CartesianStateKm{1, 2, 3, 4, 5, 6};
  ExpectAllInputsInDigest(spec);
  spec.scenario.search.algorithm = Algorithm::kNelderMead;
  spec.initial_conditions = {CartesianStateKm{1, 2, 3, 4, 5, 6}, EquinoctialState{7, 8, 9, 10, 11, 12},
                             KeplerianState{.position = KeplerianState::Position::kTrueLongitude, .position_deg = 13}};
  spec.objective = {.aggregate = Aggregate::kPercentile, .level = 0.9, .relative_to_initial = true};
  ExpectAllInputsInDigest(spec);
}

}  // namespace
}  // namespace orbitune::server_test
