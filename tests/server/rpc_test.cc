// The services over gRPC, against a server in this process: above all what they make of bad input.
#include <gmock/gmock.h>
#include <google/protobuf/map_field.h>
#include <grpcpp/generic/generic_stub.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>

#include "google/api/annotations.pb.h"
#include "grpc/health/v1/health.pb.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using ::google::protobuf::Descriptor;
using ::google::protobuf::FieldDescriptor;
using ::google::protobuf::Message;
using ::google::protobuf::MethodDescriptor;
using ::google::protobuf::ServiceDescriptor;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr std::size_t kTenMegabytes = 10 << 20;

class RpcTest : public RpcServerTest {
 protected:
  RpcTest() { client_->WaitForIterations(running_, 1); }

  // Whatever a test has done, the server is up and the other job has run on.
  ~RpcTest() override {
    const v1::Job job = client_->Get(running_);
    EXPECT_EQ(job.state(), v1::JOB_STATE_RUNNING);
    client_->WaitForIterations(running_, job.completed_iterations() + 1);
  }

  // A call of any unary method.
  grpc::Status Call(const std::string& method, const std::string& request, std::string* response = nullptr) {
    grpc::GenericStub stub(client_->channel());
    grpc::ClientContext context;
    grpc::CompletionQueue queue;
    const grpc::Slice slice(request);
    const grpc::ByteBuffer message(&slice, 1);
    grpc::ByteBuffer answer;
    grpc::Status status;
    const auto call = stub.PrepareUnaryCall(&context, method, message, &queue);
    call->StartCall();
    call->Finish(&answer, &status, &queue);
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
    std::vector<grpc::Slice> slices;
    if (response != nullptr && status.ok() && answer.Dump(&slices).ok()) {
      for (const grpc::Slice& part : slices) response->append(part.begin(), part.end());
    }
    return status;
  }

  const std::string running_ = client_->Create(SearchOptions::kMaxIterations);
};

// One fault: its field, what the description must contain of the range, and the value.
void ExpectViolation(const grpc::Status& status, const std::string& field, const std::string& range,
                     const std::string& value) {
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
  const ErrorDetails details = DetailsOf(status);
  ASSERT_EQ(details.violations.size(), 1u) << status.error_message();
  EXPECT_EQ(details.violations[0].field(), field);
  EXPECT_THAT(details.violations[0].description(), HasSubstr(range));
  EXPECT_THAT(details.violations[0].description(), HasSubstr("got " + value));
  EXPECT_THAT(status.error_message(), StartsWith(field + ": must be "));
}

TEST_F(RpcTest, BadJobsAreRefusedNamingFieldRangeAndValue) {
  struct Case {
    std::function<void(v1::Job&)> spoil;
    std::string field;
    std::string range;
    std::string value;
  };
  const auto use_preset = [](v1::Job& job, const std::string& name) {
    job.clear_scenario_definition();
    job.set_scenario(name);
  };
  const std::vector<Case> cases = {
      {[&](v1::Job& job) { use_preset(job, "scenarios/mars"); }, "job.scenario", "scenarios/gto-geo", "\"mars\""},
      {[&](v1::Job& job) { use_preset(job, "gto-geo"); }, "job.scenario", "scenarios/ID", "\"gto-geo\""},
      {[](v1::Job& job) { job.clear_scenario_definition(); }, "job.scenario", "by name or as", "neither"},
      {[](v1::Job& job) { job.set_scenario("scenarios/gto-geo"); }, "job.scenario", "by name or as", "both"},
      {[](v1::Job& job) {
         job.mutable_initial_condition()->mutable_keplerian()->set_semi_major_axis_km(7000);
         job.mutable_initial_condition()->mutable_keplerian()->set_eccentricity(1);
       },
       "job.initial_condition.keplerian.eccentricity", "[0, 1)", "1"},
      {[](v1::Job& job) { job.mutable_initial_condition()->mutable_keplerian()->set_semi_major_axis_km(-7000); },
       "job.initial_condition.keplerian.semi_major_axis_km", "> 0", "-7000"},
      {[](v1::Job& job) { job.mutable_initial_condition()->mutable_equinoctial()->set_p_km(0); },
       "job.initial_condition.equinoctial.p_km", "> 0", "0"},
      {[](v1::Job& job) { job.mutable_scenario_definition()->mutable_target()->mutable_equinoctial()->set_p_km(-5); },
       "job.scenario_definition.target.equinoctial.p_km", "> 0", "-5"},
      {[](v1::Job& job) {
         for (auto* gains : {job.mutable_hyperparameters()->mutable_initial_gains()}) {
           gains->set_k1(0.1), gains->set_k2(1), gains->set_k3(-1), gains->set_k4(1), gains->set_k5(1);
         }
       },
       "job.hyperparameters.initial_gains.k3", "[0.001, 1e+06]", "-1"},
      {[](v1::Job& job) { job.mutable_hyperparameters()->set_directions(0); }, "job.hyperparameters.directions",
       "[1, 1024]", "0"},
      {[](v1::Job& job) { job.mutable_hyperparameters()->set_iterations(1'000'000'000); },
       "job.hyperparameters.iterations", "[1, 10000000]", "1000000000"},
      {[](v1::Job& job) { job.mutable_hyperparameters()->set_iterations(-1); }, "job.hyperparameters.iterations",
       "[1, 10000000]", "-1"},
      {[](v1::Job& job) { job.mutable_hyperparameters()->set_step_size(std::nan("")); },
       "job.hyperparameters.step_size", "> 0 and finite", "nan"},
      {[](v1::Job& job) { job.mutable_hyperparameters()->set_exploration_scale(kInfinity); },
       "job.hyperparameters.exploration_scale", "> 0 and finite", "inf"},
      {[](v1::Job& job) { job.mutable_scenario_definition()->set_horizon_samples(2'000'000'000); },
       "job.scenario_definition.horizon_samples", "[1, 100000]", "2e+09"},
      {[](v1::Job& job) { job.mutable_scenario_definition()->set_control_hold(static_cast<v1::ControlHold>(7)); },
       "job.scenario_definition.control_hold", "CONTINUOUS or ZERO_ORDER", "7"},
      {[](v1::Job& job) { (*job.mutable_labels())["ok"] = std::string(257, 'x'); }, "job.labels.ok",
       "at most 256 bytes", "\"xxx"},
  };
  for (const Case& each : cases) {
    SCOPED_TRACE(each.field + " " + each.value);
    v1::CreateJobRequest request = CreateRequest(1);
    each.spoil(*request.mutable_job());
    ExpectViolation(client_->Create(request), each.field, each.range, each.value);
  }
}

TEST_F(RpcTest, TransitionsThatTheStateForbidsAreRefused) {
  const std::string ended = client_->Create(1);
  ASSERT_EQ(client_->WaitForEnd(ended).state(), v1::JOB_STATE_SUCCEEDED);
  const grpc::Status cancelled = client_->Cancel(ended);
  const grpc::Status deleted = client_->Delete(running_);
  EXPECT_THAT(cancelled.error_message(), HasSubstr(ended + " is SUCCEEDED; to cancel it, it must be QUEUED, RUNNING"));
  EXPECT_THAT(deleted.error_message(), HasSubstr(running_ + " is RUNNING; to delete it, it must be SUCCEEDED"));
  for (const grpc::Status& status : {cancelled, deleted}) {
    EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
    EXPECT_EQ(DetailsOf(status).reason, "JOB_STATE");
    EXPECT_EQ(DetailsOf(status).domain, "orbitune");
  }
  EXPECT_TRUE(client_->Delete(ended).ok());
  v1::Job gone;
  EXPECT_EQ(client_->Get(ended, &gone).error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(RpcTest, ReasonsOfConflicts) {
  v1::CreateJobRequest create = CreateRequest(1);
  create.set_request_id("once");
  v1::Job first;
  v1::Job second;
  ASSERT_TRUE(client_->Create(create, &first).ok());
  ASSERT_TRUE(client_->Create(create, &second).ok());
  EXPECT_EQ(first.name(), second.name());
  create.mutable_job()->set_display_name("another");
  const grpc::Status reused = client_->Create(create);
  EXPECT_EQ(reused.error_code(), grpc::StatusCode::ALREADY_EXISTS);
  EXPECT_EQ(DetailsOf(reused).reason, "REQUEST_ID_REUSED");

  v1::PauseJobRequest pause;
  pause.set_name(running_);
  pause.set_etag("old");
  grpc::ClientContext context;
  v1::Job job;
  const grpc::Status aborted = client_->tuning().PauseJob(&context, pause, &job);
  EXPECT_EQ(aborted.error_code(), grpc::StatusCode::ABORTED);
  EXPECT_EQ(DetailsOf(aborted).reason, "ETAG_MISMATCH");
}

TEST_F(RpcTest, AStalePageTokenIsRefused) {
  client_->WaitForEnd(client_->Create(1));
  v1::ListJobsRequest request;
  request.set_page_size(1);
  v1::ListJobsResponse page;
  grpc::ClientContext first;
  ASSERT_TRUE(client_->tuning().ListJobs(&first, request, &page).ok());
  ASSERT_NE(page.next_page_token(), "");
  request.set_page_token(page.next_page_token());
  request.set_filter("state = RUNNING");
  grpc::ClientContext second;
  ExpectViolation(client_->tuning().ListJobs(&second, request, &page), "page_token", "same parent, filter, order",
                  "\"" + request.page_token());
}

// ---- Every double field.

// The fields of a message and of the messages set in it, each as the way to it.
using Path = std::vector<const FieldDescriptor*>;

void FindFields(const Message& message, FieldDescriptor::CppType type, const Path& prefix, std::vector<Path>& found) {
  for (int i = 0; i < message.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor* field = message.GetDescriptor()->field(i);
    Path path = prefix;
    path.push_back(field);
    if (field->is_repeated()) continue;
    if (field->cpp_type() == type) found.push_back(path);
    if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE && message.GetReflection()->HasField(message, field)) {
      FindFields(message.GetReflection()->GetMessage(message, field), type, path, found);
    }
  }
}

std::string TextOf(const Path& path) {
  std::string text;
  for (const FieldDescriptor* field : path) text += (text.empty() ? "" : ".") + field->name();
  return text;
}

// The message that the path's last field is in.
Message& HolderOf(Message& message, const Path& path) {
  Message* holder = &message;
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    holder = holder->GetReflection()->MutableMessage(holder, path[i]);
  }
  return *holder;
}

void SetDouble(Message& message, const Path& path, double value) {
  Message& holder = HolderOf(message, path);
  holder.GetReflection()->SetDouble(&holder, path.back(), value);
}

// An orbit in each of its three forms, near the small scenario's target.
void SetOrbit(int form, v1::OrbitState* state) {
  if (form == 0) {
    auto* k = state->mutable_keplerian();
    k->set_semi_major_axis_km(7390);
    k->set_eccentricity(0.001);
    k->set_inclination_deg(81);
    k->set_raan_deg(1);
    k->set_argument_of_periapsis_deg(2);
    k->set_true_anomaly_deg(42);
  } else if (form == 1) {
    *state->mutable_equinoctial() = SmallDefinition(1).chaser().equinoctial();
  } else {
    auto* c = state->mutable_cartesian();
    c->set_x_km(5000);
    c->set_y_km(1000);
    c->set_z_km(5300);
    c->set_x_dot_km_s(-5);
    c->set_y_dot_km_s(1);
    c->set_z_dot_km_s(5);
  }
}

void FillHyperparameters(v1::Hyperparameters* parameters) {
  *parameters = SmallDefinition(2).hyperparameters();
  parameters->set_directions(2);
}

v1::CreateJobRequest WholeRequest(int form) {
  v1::CreateJobRequest request = CreateRequest(2);
  v1::Job& job = *request.mutable_job();
  SetOrbit(form, job.mutable_scenario_definition()->mutable_target());
  SetOrbit(form, job.mutable_scenario_definition()->mutable_chaser());
  SetOrbit(form, job.mutable_initial_condition());
  FillHyperparameters(job.mutable_scenario_definition()->mutable_hyperparameters());
  return request;
}

// Any finite value has a meaning: an angle, or an inclination vector.
bool TakesAnyFinite(const std::string& name) {
  static const std::set<std::string> fields = {
      "raan_deg", "argument_of_periapsis_deg", "true_anomaly_deg", "true_longitude_deg", "hx", "hy"};
  return fields.contains(name);
}

// What a value out of all reason in one field must lead to.
void ExpectNamed(const grpc::Status& status, const Path& path, double value) {
  if (status.ok()) {
    EXPECT_TRUE(std::isfinite(value) && TakesAnyFinite(path.back()->name())) << "accepted";
    return;
  }
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
  const ErrorDetails details = DetailsOf(status);
  const std::string text = TextOf(path);
  // A finite value may be wrong only together with those beside it.
  const std::string form = text.substr(0, text.rfind('.'));
  const bool named = std::ranges::any_of(details.violations, [&](const auto& violation) {
    return violation.field() == text || (std::isfinite(value) && violation.field().starts_with(form));
  });
  EXPECT_TRUE(named) << status.error_message();
  EXPECT_LT(details.violations.size(), 8u) << status.error_message();
}

TEST_F(RpcTest, NoDoubleOfAJobIsTakenUnseen) {
  int fields = 0;
  for (int form = 0; form < 3; ++form) {
    for (const bool own : {false, true}) {  // hyperparameters of the job, or of the definition
      v1::CreateJobRequest whole = WholeRequest(form);
      if (own) FillHyperparameters(whole.mutable_job()->mutable_hyperparameters());
      const grpc::Status valid = client_->Create(whole);
      ASSERT_TRUE(valid.ok()) << valid.error_message();
      std::vector<Path> paths;
      FindFields(whole, FieldDescriptor::CPPTYPE_DOUBLE, {}, paths);
      for (const Path& path : paths) {
        if (own && TextOf(path).starts_with("job.scenario_definition.")) continue;  // had their turn
        ++fields;
        for (const double value : {std::nan(""), kInfinity, -kInfinity, -1e308}) {
          SCOPED_TRACE(TextOf(path) + " = " + std::to_string(value));
          v1::CreateJobRequest spoiled = whole;
          SetDouble(spoiled, path, value);
          v1::Job job;
          const grpc::Status status = client_->Create(spoiled, &job);
          ExpectNamed(status, path, value);
          if (status.ok()) {
            EXPECT_TRUE(HasEnded(client_->WaitForEnd(job.name()).state()));
          }
        }
      }
    }
  }
  EXPECT_GT(fields, 90);
}

TEST_F(RpcTest, NoDoubleOfAnEpisodeIsTakenUnseen) {
  for (int form = 0; form < 3; ++form) {
    v1::SimulateEpisodeRequest whole;
    *whole.mutable_scenario_definition() = WholeRequest(form).job().scenario_definition();
    *whole.mutable_initial_condition() = WholeRequest(form).job().initial_condition();
    *whole.mutable_gains() = whole.scenario_definition().hyperparameters().initial_gains();
    std::vector<Path> paths;
    FindFields(whole, FieldDescriptor::CPPTYPE_DOUBLE, {}, paths);
    for (const Path& path : paths) {
      for (const double value : {std::nan(""), kInfinity, -kInfinity, -1e308}) {
        SCOPED_TRACE(TextOf(path) + " = " + std::to_string(value));
        v1::SimulateEpisodeRequest spoiled = whole;
        SetDouble(spoiled, path, value);
        grpc::ClientContext context;
        v1::SimulateEpisodeResponse response;
        const grpc::Status status = client_->simulation().SimulateEpisode(&context, spoiled, &response);
        if (TextOf(path).starts_with("scenario_definition.hyperparameters.")) {
          EXPECT_TRUE(status.ok()) << "an episode has no search";
        } else {
          ExpectNamed(status, path, value);
        }
      }
    }
  }
}

TEST_F(RpcTest, WhatIsOutputOnlyIsIgnoredOnInput) {
  v1::CreateJobRequest request = CreateRequest(1);
  request.set_validate_only(true);
  v1::Job expected;
  ASSERT_TRUE(client_->Create(request, &expected).ok());
  v1::Job& job = *request.mutable_job();
  job.set_name(running_);
  job.set_state(v1::JOB_STATE_FAILED);
  job.set_last_seq(-5);
  job.set_etag("etag");
  job.set_error_message("error");
  job.set_completed_iterations(7);
  job.mutable_report()->mutable_best()->mutable_result()->set_cost(std::nan(""));
  job.mutable_best_iteration()->set_cost(kInfinity);
  v1::Job actual;
  ASSERT_TRUE(client_->Create(request, &actual).ok());
  EXPECT_EQ(actual.SerializeAsString(), expected.SerializeAsString());
}

// The error of a request with everything wrong still reaches a client.
TEST_F(RpcTest, ManyFaultsFitIntoOneError) {
  v1::CreateJobRequest request = WholeRequest(0);
  FillHyperparameters(request.mutable_job()->mutable_hyperparameters());
  std::vector<Path> paths;
  FindFields(request, FieldDescriptor::CPPTYPE_DOUBLE, {}, paths);
  for (const Path& path : paths) SetDouble(request, path, std::nan(""));
  auto& labels = *request.mutable_job()->mutable_labels();
  for (int i = 0; i < 1000; ++i) labels["Bad " + std::to_string(i)].assign(1, 'x');
  request.mutable_job()->set_display_name(std::string(300, 'x'));
  const grpc::Status status = client_->Create(request);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
  const ErrorDetails details = DetailsOf(status);
  EXPECT_GT(details.violations.size(), 10u);
  EXPECT_THAT(details.violations.back().description(), HasSubstr("more violations"));
}

// ---- Every string field.

const std::vector<const ServiceDescriptor*>& Services() {
  static const auto* const services = [] {
    auto* found = new std::vector<const ServiceDescriptor*>;
    for (const auto* file :
         {v1::Job::descriptor()->file(), v1::Scenario::descriptor()->file(), v1::EpisodeResult::descriptor()->file()}) {
      for (int i = 0; i < file->service_count(); ++i) found->push_back(file->service(i));
    }
    return found;
  }();
  return *services;
}

std::string RouteOf(const MethodDescriptor& method) {
  return "/" + method.service()->full_name() + "/" + method.name();
}

// A request that the method takes, of a job that may be asked for it.
std::unique_ptr<Message> RequestOf(const MethodDescriptor& method, const std::string& job) {
  std::unique_ptr<Message> request(
      google::protobuf::MessageFactory::generated_factory()->GetPrototype(method.input_type())->New());
  for (const char* field : {"name", "parent"}) {
    const FieldDescriptor* descriptor = method.input_type()->FindFieldByName(field);
    if (descriptor != nullptr) request->GetReflection()->SetString(request.get(), descriptor, job);
  }
  if (auto* create = dynamic_cast<v1::CreateJobRequest*>(request.get())) {
    *create = WholeRequest(1);
    create->set_validate_only(true);
    create->mutable_job()->mutable_report()->mutable_final()->mutable_result();
  } else if (auto* simulate = dynamic_cast<v1::SimulateEpisodeRequest*>(request.get())) {
    *simulate->mutable_scenario_definition() = SmallDefinition(1);
  }
  return request;
}

TEST_F(RpcTest, TenMegabytesInAnyStringAreAClearError) {
  const std::string large(kTenMegabytes, 'x');
  int fields = 0;
  for (const ServiceDescriptor* service : Services()) {
    for (int i = 0; i < service->method_count(); ++i) {
      const MethodDescriptor& method = *service->method(i);
      if (method.server_streaming()) continue;  // WatchTest's
      const auto request = RequestOf(method, running_);
      std::vector<Path> paths;
      FindFields(*request, FieldDescriptor::CPPTYPE_STRING, {}, paths);
      for (const Path& path : paths) {
        SCOPED_TRACE(method.full_name() + " " + TextOf(path));
        ++fields;
        std::unique_ptr<Message> spoiled(request->New());
        spoiled->CopyFrom(*request);
        Message& holder = HolderOf(*spoiled, path);
        holder.GetReflection()->SetString(&holder, path.back(), large);
        const grpc::Status status = Call(RouteOf(method), spoiled->SerializeAsString());
        EXPECT_LT(status.error_message().size(), 1500u);
        const std::string field = TextOf(path);
        if (field == "etag") {
          EXPECT_THAT(status.error_code(), AnyOf(grpc::StatusCode::ABORTED, grpc::StatusCode::FAILED_PRECONDITION));
        } else if (field == "job.name" || field == "job.etag" || field == "job.error_message" ||
                   field == "job.campaign" || field == "job.owner" || field.starts_with("job.report.") ||
                   field.starts_with("job.provenance.")) {
          EXPECT_TRUE(status.ok()) << "output only: " << status.error_message();
        } else {
          EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
          const ErrorDetails details = DetailsOf(status);
          ASSERT_FALSE(details.violations.empty());
          EXPECT_EQ(details.violations[0].field(), field);
        }
      }
    }
  }
  EXPECT_GE(fields, 25);
}

TEST_F(RpcTest, TenMegabytesInALabel) {
  const std::string large(kTenMegabytes, 'x');
  v1::CreateJobRequest key = CreateRequest(1);
  (*key.mutable_job()->mutable_labels())[large] = "x";
  v1::CreateJobRequest value = CreateRequest(1);
  (*value.mutable_job()->mutable_labels())["key"] = large;
  for (const auto& request : {key, value}) {
    const grpc::Status status = client_->Create(request);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
    EXPECT_THAT(DetailsOf(status).violations.at(0).field(), StartsWith("job.labels"));
  }
}

TEST_F(RpcTest, WhatIsNoMessageIsRefused) {
  for (const ServiceDescriptor* service : Services()) {
    for (int i = 0; i < service->method_count(); ++i) {
      const MethodDescriptor& method = *service->method(i);
      EXPECT_FALSE(Call(RouteOf(method), "\xff\xff\xff\xff").ok()) << method.full_name();
    }
  }
}

// ---- The contract's shape.

TEST_F(RpcTest, EveryMethodHasItsHttpRule) {
  int methods = 0;
  for (const ServiceDescriptor* service : Services()) {
    for (int i = 0; i < service->method_count(); ++i, ++methods) {
      const MethodDescriptor& method = *service->method(i);
      ASSERT_TRUE(method.options().HasExtension(google::api::http)) << method.full_name();
      const google::api::HttpRule& rule = method.options().GetExtension(google::api::http);
      const bool reads = std::ranges::any_of(std::array{"Get", "List", "Watch", "Verify"},
                                             [&](const char* verb) { return method.name().starts_with(verb); });
      EXPECT_EQ(reads, rule.pattern_case() == google::api::HttpRule::kGet) << method.full_name();
      const std::string& route = !rule.get().empty() ? rule.get() : rule.post() + rule.delete_();
      EXPECT_THAT(route, StartsWith("/v1/")) << method.full_name();
    }
  }
  EXPECT_EQ(methods, 13);
}

TEST_F(RpcTest, HealthIsServing) {
  for (const std::string service : {"", "orbitune.v1.TuningService", "orbitune.v1.ScenarioService"}) {
    grpc::health::v1::HealthCheckRequest request;
    request.set_service(service);
    std::string answer;
    const grpc::Status status = Call("/grpc.health.v1.Health/Check", request.SerializeAsString(), &answer);
    ASSERT_TRUE(status.ok()) << status.error_message();
    grpc::health::v1::HealthCheckResponse response;
    ASSERT_TRUE(response.ParseFromString(answer));
    EXPECT_EQ(response.status(), grpc::health::v1::HealthCheckResponse::SERVING);
  }
}

TEST_F(RpcTest, ReflectionDescribesEveryService) {
  const std::string route = "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo";
  std::string services;
  ASSERT_TRUE(Call(route, "\x3a\x01*", &services).ok());  // list_services
  for (const std::string service : {"orbitune.v1.TuningService", "orbitune.v1.ScenarioService",
                                    "orbitune.v1.SimulationService", "grpc.health.v1.Health"}) {
    EXPECT_THAT(services, HasSubstr(service));
    std::string file;  // file_containing_symbol
    ASSERT_TRUE(Call(route, "\x22" + std::string(1, static_cast<char>(service.size())) + service, &file).ok());
    EXPECT_THAT(file, HasSubstr(".proto")) << service;
    EXPECT_THAT(file, HasSubstr(service.substr(service.rfind('.') + 1)));
  }
}

TEST_F(RpcTest, ScenariosAreWhatAJobOfTheirNameFlies) {
  grpc::ClientContext list_context;
  v1::ListScenariosResponse list;
  ASSERT_TRUE(client_->scenarios().ListScenarios(&list_context, {}, &list).ok());
  EXPECT_EQ(list.scenarios_size(), 3);
  for (const v1::Scenario& scenario : list.scenarios()) {
    grpc::ClientContext get_context;
    v1::GetScenarioRequest get;
    get.set_name(scenario.name());
    v1::Scenario same;
    ASSERT_TRUE(client_->scenarios().GetScenario(&get_context, get, &same).ok());
    EXPECT_EQ(same.SerializeAsString(), scenario.SerializeAsString());
    v1::CreateJobRequest request;
    request.mutable_job()->set_scenario(scenario.name());
    request.set_validate_only(true);
    v1::Job job;
    ASSERT_TRUE(client_->Create(request, &job).ok());
    EXPECT_EQ(job.scenario_definition().SerializeAsString(), scenario.SerializeAsString());
    EXPECT_EQ(job.initial_condition().SerializeAsString(), scenario.chaser().SerializeAsString());
  }
  grpc::ClientContext context;
  v1::GetScenarioRequest unknown;
  unknown.set_name("scenarios/mars");
  v1::Scenario none;
  EXPECT_EQ(client_->scenarios().GetScenario(&context, unknown, &none).error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(RpcTest, AJobAnswersAsItWasAsked) {
  v1::CreateJobRequest request = WholeRequest(2);
  request.mutable_job()->set_display_name("named");
  (*request.mutable_job()->mutable_labels())["case"] = "1";
  request.mutable_job()->mutable_hyperparameters()->set_seed(std::numeric_limits<std::uint64_t>::max());
  v1::Job created;
  ASSERT_TRUE(client_->Create(request, &created).ok());
  const v1::Job job = client_->WaitForEnd(created.name());
  for (const v1::Job& answer : {created, job}) {
    EXPECT_EQ(answer.display_name(), "named");
    EXPECT_EQ(answer.labels().at("case"), "1");
    EXPECT_EQ(answer.initial_condition().SerializeAsString(), request.job().initial_condition().SerializeAsString());
    EXPECT_EQ(answer.hyperparameters().seed(), std::numeric_limits<std::uint64_t>::max());
    EXPECT_EQ(answer.hyperparameters().directions(), 2);
  }
  EXPECT_EQ(job.completed_iterations(), 2);
  EXPECT_TRUE(job.has_report());
  EXPECT_EQ(client_->Iterations(job.name()).iterations(0).SerializeAsString(),
            job.initial_iteration().SerializeAsString());
}

TEST_F(RpcTest, AnEpisodesTrajectoryIsThePapersQuantities) {
  v1::SimulateEpisodeRequest request;
  *request.mutable_scenario_definition() = SmallDefinition(1);
  request.set_include_trajectory(true);
  v1::SimulateEpisodeResponse response;
  grpc::ClientContext context;
  ASSERT_TRUE(client_->simulation().SimulateEpisode(&context, request, &response).ok());
  ASSERT_EQ(response.trajectory_size(), 21);
  const v1::TrajectorySample& first = response.trajectory(0);
  const auto& chaser = request.scenario_definition().chaser().equinoctial();
  EXPECT_NEAR(first.chaser().p_km(), chaser.p_km(), 1e-9 * chaser.p_km());
  EXPECT_NEAR(first.chaser().hx(), chaser.hx(), 1e-12);
  EXPECT_NEAR(first.chaser().true_longitude_deg(), chaser.true_longitude_deg(), 1e-9);
  EXPECT_NEAR(first.target().p_km(), 7378.137, 1e-9);
  EXPECT_DOUBLE_EQ(first.lyapunov(), response.result().initial_lyapunov());
  for (int i = 1; i <= 20; ++i) {
    EXPECT_DOUBLE_EQ(response.trajectory(i).time_s(), i * 180.0);
    EXPECT_LT(response.trajectory(i).lyapunov(), response.trajectory(i - 1).lyapunov());
  }
}

}  // namespace
}  // namespace orbitune::server_test
