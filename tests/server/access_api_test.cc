// Who may call what, over both transports: every method there is, with every kind of caller.
#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>
#include <gtest/gtest.h>

#include <map>

#include "absl/strings/match.h"
#include "google/protobuf/descriptor_database.h"
#include "orbitune/v1/access.pb.h"
#include "orbitune/v1/audit.grpc.pb.h"
#include "server/api/json.h"
#include "server/rest/routes.h"
#include "tests/server/engine_support.h"
#include "tests/server/rest_support.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using grpc::StatusCode;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using Reply = HttpClient::Reply;

// More than all methods are called wrongly in a test here.
constexpr int kFailures = 250;

std::string Bearer(const std::string& token) { return token.empty() ? "" : "Authorization: Bearer " + token + "\r\n"; }

class AccessApiTest : public testing::Test {
 protected:
  AccessApiTest() : console_(*AccessStore::Open(directory_.File("access.db"))), engine_(directory_.File("jobs.db")) {
    viewer_ = AddToken("vera", Role::kViewer);
    ana_ = AddToken("ana", Role::kOperator);
    bob_ = AddToken("bob", Role::kOperator);
    admin_ = AddToken("root", Role::kAdmin);
    expired_ = AddToken("late", Role::kAdmin, NowUs() - 1);
    revoked_ = AddToken("gone", Role::kAdmin);
    EXPECT_TRUE(console_->RevokeTokens("gone", NowUs()).ok());
    access_ = *Access::Open(directory_.File("access.db"),
                            {.failures_at_once = kFailures, .period = std::chrono::milliseconds(10)});
    api_ = std::make_unique<Api>(engine_.use_cases(), engine_.campaigns(), engine_.gains(), access_.get());
    rpc_ = *RpcServer::Start("127.0.0.1:0", *api_);
    http_ = *HttpServer::Start({.address = "127.0.0.1:0", .log = [](const std::string&) {}}, *api_);
    client_ = std::make_unique<Client>(rpc_->address());
  }
  ~AccessApiTest() override {
    http_->Shutdown(std::chrono::seconds(2));
    rpc_->Shutdown(std::chrono::seconds(2));
  }

  std::string AddToken(const std::string& name, Role role, std::int64_t expire_time_us = 0) {
    const Secret secret = Secret::New();
    EXPECT_TRUE(console_
                    ->AddToken({.id = secret.id,
                                .name = name,
                                .role = role,
                                .digest = secret.digest,
                                .create_time_us = NowUs(),
                                .expire_time_us = expire_time_us})
                    .ok());
    return secret.text;
  }

  // Any method, unary or a stream (to its end, or a few messages of it); field: of the request, set to `name`.
  grpc::Status Rpc(const Method& method, const std::string& token, const std::string& field = "",
                   const std::string& name = "") {
    const std::unique_ptr<google::protobuf::Message> request(method.request->New());
    if (!field.empty()) {
      request->GetReflection()->SetString(request.get(), request->GetDescriptor()->FindFieldByName(field), name);
    }
    const std::string path = "/" + method.descriptor->service()->full_name() + "/" + method.descriptor->name();
    grpc::GenericStub stub(client_->channel());
    grpc::ClientContext context;
    if (!token.empty()) context.AddMetadata("authorization", "Bearer " + token);
    grpc::CompletionQueue queue;
    const auto done = [&queue] {
      void* tag = nullptr;
      bool ok = false;
      return queue.Next(&tag, &ok) && ok;
    };
    const auto call = stub.PrepareCall(&context, path, &queue);
    call->StartCall(nullptr);
    const grpc::Slice slice(request->SerializeAsString());
    if (done()) {
      call->WriteLast(grpc::ByteBuffer(&slice, 1), grpc::WriteOptions(), nullptr);
      done();
      grpc::ByteBuffer answer;
      for (int i = 0;; ++i) {
        call->Read(&answer, nullptr);
        if (!done()) break;
        if (i == 3) context.TryCancel();
      }
    }
    grpc::Status status;
    call->Finish(&status, nullptr);
    done();
    return status;
  }

  Reply Http(const std::string& method, const std::string& target, const std::string& headers = "",
             const std::string& body = "") {
    return HttpClient(http_->address())
        .Call(method, target, body, headers + (body.empty() ? "" : "Content-Type: application/json\r\n"));
  }
  static std::string TargetOf(const rest::Route& route) {
    std::string target;
    for (const rest::PathTemplate::Segment& segment : route.path.segments) {
      target += "/" + (segment.kind == rest::PathTemplate::Segment::Kind::kLiteral ? segment.literal : "nosuch");
    }
    if (!route.path.verb.empty()) target += ":" + route.path.verb;
    return target;
  }
  Reply Http(const rest::Route& route, const std::string& token) {
    return Http(route.http_method, TargetOf(route), Bearer(token), route.body.empty() ? "" : "{}");
  }
  // The head of a request that announces a body; headers: whole lines, with the body's length.
  static std::string HeadOf(const std::string& method, const std::string& target, const std::string& headers) {
    return method + " " + target + " HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n" + headers +
           "\r\n";
  }

  std::string CreateJobAs(const std::string& owner) {
    NewJob job = JobOf(EndlessScenario());
    job.owner = owner;
    const auto record = engine_.use_cases().CreateJob(job, "", false);
    EXPECT_TRUE(record.ok()) << record.status();
    return "jobs/" + record->id;
  }
  std::string CreateCampaignAs(const std::string& owner) {
    CampaignRequest request{.job = JobOf(EndlessScenario())};
    request.job.owner = owner;
    request.initial_conditions.list = {EndlessScenario().chaser};
    const auto record = engine_.campaigns().Create(request, "", false);
    EXPECT_TRUE(record.ok()) << record.status();
    return "campaigns/" + record->id;
  }

  std::vector<AuditEntry> Entries() { return *console_->ListAudit({}); }
  // Polls for an entry; fails the test where it takes minutes.
  AuditEntry WaitForEntry(const std::function<bool(const AuditEntry&)>& condition) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(1);
    while (std::chrono::steady_clock::now() < deadline) {
      for (const AuditEntry& entry : Entries()) {
        if (condition(entry)) return entry;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    ADD_FAILURE() << "no such entry in the audit log";
    return {};
  }

  // The cookie that logging in gives.
  std::string LogIn(const std::string& token) {
    const Reply reply = Http("POST", "/v1/session", "", R"({"token": ")" + token + "\"}");
    EXPECT_EQ(reply.code, 200) << reply.body;
    const std::string& cookie = reply.headers.at("set-cookie");
    EXPECT_THAT(cookie, AllOf(HasSubstr("; HttpOnly"), HasSubstr("; SameSite=Strict"), HasSubstr("; Path=/"),
                              HasSubstr("; Max-Age=43200"), Not(HasSubstr("Secure"))));
    return "Cookie: theme=dark; " + cookie.substr(0, cookie.find(';')) + "\r\n";
  }
  // What a stream that has been open ends with.
  static void ExpectLastWord(EventStream& stream, const std::string& reason) {
    ASSERT_EQ(stream.head().code, 200);
    const std::vector<StreamEvent> events = stream.ReadAll();
    ASSERT_FALSE(events.empty());
    EXPECT_THAT(events.back().json, AllOf(HasSubstr(R"("status":"UNAUTHENTICATED")"), HasSubstr(reason)));
    EXPECT_TRUE(stream.ended_well());
  }
  std::string OwnOrigin() const { return "Origin: http://localhost\r\n"; }

  TemporaryDirectory directory_;
  const std::unique_ptr<AccessStore> console_;
  Engine engine_;
  std::unique_ptr<Access> access_;
  std::unique_ptr<Api> api_;
  std::unique_ptr<RpcServer> rpc_;
  std::unique_ptr<HttpServer> http_;
  std::unique_ptr<Client> client_;
  std::string viewer_, ana_, bob_, admin_, expired_, revoked_;
};

// A service that nobody has added, and a method without a rule, are found here; the server would not even start.
TEST_F(AccessApiTest, EveryMethodOfEveryProtoIsServedByARule) {
  std::vector<std::string> files;
  ASSERT_TRUE(google::protobuf::DescriptorPool::internal_generated_database()->FindAllFileNames(&files));
  int methods = 0;
  for (const std::string& file : files) {
    if (!file.starts_with("orbitune/")) continue;
    const auto* descriptor = google::protobuf::DescriptorPool::generated_pool()->FindFileByName(file);
    for (int s = 0; s < descriptor->service_count(); ++s) {
      for (int m = 0; m < descriptor->service(s)->method_count(); ++m, ++methods) {
        const auto* method = descriptor->service(s)->method(m);
        EXPECT_NE(method->options().GetExtension(v1::access).role(), v1::ROLE_UNSPECIFIED) << method->full_name();
        EXPECT_NE(api_->methods().Find(method->full_name()), nullptr) << method->full_name();
      }
    }
  }
  EXPECT_EQ(methods, static_cast<int>(api_->methods().all().size()));
  EXPECT_GT(methods, 25);
}

TEST_F(AccessApiTest, EveryMethodRefusesWhoHasNoValidToken) {
  const std::map<std::string, std::string> reasons = {
      {"", "TOKEN_REQUIRED"}, {revoked_, "TOKEN_REVOKED"}, {expired_, "TOKEN_EXPIRED"}};
  for (const auto& [name, method] : api_->methods().all()) {
    for (const auto& [token, reason] : reasons) {
      const grpc::Status status = Rpc(method, token);
      EXPECT_EQ(status.error_code(), StatusCode::UNAUTHENTICATED) << name << " " << status.error_message();
      EXPECT_EQ(DetailsOf(status).reason, reason) << name;
    }
  }
  const rest::RouteTable routes(api_->methods());
  for (const rest::Route& route : routes.all()) {
    for (const auto& [token, reason] : reasons) {
      const Reply reply = Http(route, token);
      EXPECT_EQ(reply.code, 401) << route.text;
      EXPECT_THAT(reply.body, HasSubstr(reason));
      EXPECT_EQ(reply.headers.at("www-authenticate"),
                token.empty() ? R"(Bearer realm="orbitune")" : R"(Bearer realm="orbitune", error="invalid_token")");
    }
  }
}

TEST_F(AccessApiTest, EveryMethodAsksForItsRole) {
  const std::map<Role, std::string> tokens = {
      {Role::kViewer, viewer_}, {Role::kOperator, bob_}, {Role::kAdmin, admin_}};
  const rest::RouteTable routes(api_->methods());
  for (const auto& [role, token] : tokens) {
    for (const auto& [name, method] : api_->methods().all()) {
      const grpc::Status status = Rpc(method, token);
      EXPECT_NE(status.error_code(), StatusCode::UNAUTHENTICATED) << name;
      EXPECT_EQ(status.error_code() == StatusCode::PERMISSION_DENIED, role < method.access.role)
          << name << " as " << NameOf(role) << ": " << status.error_message();
      if (status.error_code() == StatusCode::PERMISSION_DENIED) {
        EXPECT_EQ(DetailsOf(status).reason, "ROLE_REQUIRED");
        EXPECT_THAT(status.error_message(), HasSubstr("needs the role " + std::string(NameOf(method.access.role))));
      }
    }
    for (const rest::Route& route : routes.all()) {
      const Reply reply = Http(route, token);
      EXPECT_NE(reply.code, 401) << route.text;
      EXPECT_EQ(reply.code == 403, role < route.method->access.role) << route.text << " as " << NameOf(role);
    }
  }
}

// None of these bodies is ever sent: the answer cannot have waited for it.
TEST_F(AccessApiTest, WhoMayNotSendABodyIsToldByTheHeadAlone) {
  const rest::RouteTable routes(api_->methods());
  int bodies = 0;
  for (const rest::Route& route : routes.all()) {
    if (route.body.empty()) continue;
    ++bodies;
    for (const std::string announced : {"Content-Length: 1000000\r\n", "Transfer-Encoding: chunked\r\n",
                                        "Expect: 100-continue\r\nContent-Length: 1000000\r\n"}) {
      for (const std::string& token : {std::string(), revoked_, expired_, viewer_}) {
        if (token == viewer_ && route.method->access.role <= Role::kViewer) continue;
        HttpClient client(http_->address());
        client.Send(HeadOf(route.http_method, TargetOf(route), Bearer(token) + announced));
        const Reply reply = client.ReadReply();
        EXPECT_EQ(reply.code, token == viewer_ ? 403 : 401) << route.text << " " << announced;
        EXPECT_EQ(reply.headers.at("connection"), "close");
        EXPECT_EQ(reply.headers.at("x-content-type-options"), "nosniff");
        EXPECT_TRUE(client.Closes());
      }
    }
  }
  EXPECT_GT(bodies, 8);
  // One of another page, and what is no JSON, likewise; and nothing large to where anybody may send.
  const std::string length = "Content-Length: 1000000\r\n";
  for (const auto& [head, code] : std::map<std::string, int>{
           {HeadOf("POST", "/v1/jobs", Bearer(ana_) + "Origin: https://example.org\r\n" + length), 403},
           {HeadOf("POST", "/v1/jobs", Bearer(ana_) + "Content-Encoding: gzip\r\n" + length), 415},
           {HeadOf("POST", "/v1/session", length), 413},
           {HeadOf("GET", "/healthz", length), 413}}) {
    HttpClient client(http_->address());
    client.Send(head);
    EXPECT_EQ(client.ReadReply().code, code) << head;
  }
}

TEST_F(AccessApiTest, ARefusalReachesWhoGoesOnSending) {
  const std::string part(1 << 20, ' ');
  for (const std::string announced : {"Content-Length: 4194304\r\n", "Transfer-Encoding: chunked\r\n"}) {
    HttpClient client(http_->address());
    client.Send(HeadOf("POST", "/v1/jobs", announced));
    for (int i = 0; i < 4; ++i) EXPECT_TRUE(client.Send("100000\r\n" + part + "\r\n"));
    EXPECT_EQ(client.ReadReply().code, 401);
    EXPECT_TRUE(client.Closes());
  }
  // Each is one refusal.
  const AuditEntry refused = WaitForEntry([](const AuditEntry& entry) { return entry.outcome == "UNAUTHENTICATED"; });
  EXPECT_EQ(refused.method, "orbitune.v1.TuningService.CreateJob");
  EXPECT_LE(refused.count, 2);
}

TEST_F(AccessApiTest, ATokenRevokedWhileTheBodyComesCountsNoMore) {
  const std::string body = ToJson(CreateRequest(SearchOptions::kMaxIterations).job());
  HttpClient client(http_->address());
  client.Send(HeadOf("POST", "/v1/jobs",
                     Bearer(ana_) + "Expect: 100-continue\r\nContent-Length: " + std::to_string(body.size()) + "\r\n"));
  EXPECT_EQ(client.ReadHead().code, 100);
  ASSERT_TRUE(console_->RevokeTokens("ana", NowUs()).ok());
  for (int i = 0; i < 6000 && Http("GET", "/v1/caller", Bearer(ana_)).code != 401; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  client.Send(body);
  EXPECT_EQ(client.ReadReply().code, 401);
}

TEST_F(AccessApiTest, WhatIsAnothersIsItsOwnersAndTheAdminsToSteer) {
  int owned = 0;
  for (const auto& [name, method] : api_->methods().all()) {
    if (method.access.owned == nullptr) continue;
    ++owned;
    const auto create = [&, is_job = method.access.collection == "jobs"](const std::string& owner) {
      return is_job ? CreateJobAs(owner) : CreateCampaignAs(owner);
    };
    const std::string& field = method.access.owned->name();
    for (const std::string& others : {create("ana"), create("")}) {
      const grpc::Status status = Rpc(method, bob_, field, others);
      EXPECT_EQ(status.error_code(), StatusCode::PERMISSION_DENIED) << name;
      EXPECT_EQ(DetailsOf(status).reason, "OWNER_REQUIRED") << name;
      EXPECT_THAT(status.error_message(), HasSubstr(others));
    }
    EXPECT_NE(Rpc(method, ana_, field, create("ana")).error_code(), StatusCode::PERMISSION_DENIED) << name;
    EXPECT_NE(Rpc(method, admin_, field, create("ana")).error_code(), StatusCode::PERMISSION_DENIED) << name;
  }
  EXPECT_GE(owned, 9);
  const std::string job = CreateJobAs("ana");
  EXPECT_EQ(Http("POST", "/v1/" + job + ":cancel", Bearer(bob_), "{}").code, 403);
  EXPECT_EQ(Http("GET", "/v1/" + job, Bearer(bob_)).code, 200);
  EXPECT_EQ(Http("GET", "/v1/" + job, Bearer(viewer_)).code, 200);
  EXPECT_EQ(Http("POST", "/v1/" + job + ":cancel", Bearer(ana_), "{}").code, 200);
}

TEST_F(AccessApiTest, WhoCreatesOwns) {
  v1::CreateJobRequest request = CreateRequest(SearchOptions::kMaxIterations);
  request.mutable_job()->set_owner("bob");  // output only
  grpc::ClientContext context;
  context.AddMetadata("authorization", "Bearer " + ana_);
  v1::Job job;
  ASSERT_TRUE(client_->tuning().CreateJob(&context, request, &job).ok());
  EXPECT_EQ(job.owner(), "ana");
  v1::Job read;
  ASSERT_TRUE(FromJson(Http("GET", "/v1/" + job.name(), Bearer(viewer_)).body, &read).ok());
  EXPECT_EQ(read.owner(), "ana");
  v1::Campaign campaign;
  *campaign.mutable_scenario_definition() = SmallDefinition(3);
  *campaign.mutable_initial_conditions()->add_list() = SmallDefinition(3).chaser();
  const Reply reply = Http("POST", "/v1/campaigns", Bearer(bob_), ToJson(campaign));
  ASSERT_EQ(reply.code, 200) << reply.body;
  ASSERT_TRUE(FromJson(reply.body, &campaign).ok());
  EXPECT_EQ(campaign.owner(), "bob");
  const auto members = engine_.use_cases().ListJobs(10, "", "campaign = " + campaign.name().substr(10), "");
  ASSERT_TRUE(members.ok());
  EXPECT_FALSE(members->items.empty());
  for (const JobRecord& member : members->items) EXPECT_EQ(member.spec.owner, "bob");
}

TEST_F(AccessApiTest, HealthReflectionAndFilesAreOpen) {
  for (const char* const path : {"/healthz", "/readyz", "/openapi.json"}) EXPECT_EQ(Http("GET", path).code, 200);
  EXPECT_NE(Http("GET", "/").code, 401);
  EXPECT_NE(Http("GET", "/v1/nosuch").code, 200);
}

TEST_F(AccessApiTest, SaysWhoTheCallerIs) {
  EXPECT_THAT(
      Http("GET", "/v1/caller", Bearer(viewer_)).body,
      AllOf(HasSubstr(R"("name":"vera")"), HasSubstr(R"("role":"ROLE_VIEWER")"), HasSubstr(R"("has_token":true)")));
}

TEST_F(AccessApiTest, ABrowserLogsInAndOut) {
  const std::string cookie = LogIn(ana_);
  EXPECT_THAT(Http("GET", "/v1/caller", cookie).body, HasSubstr(R"("name":"ana")"));
  const std::string job = CreateJobAs("ana");
  // A token, where there is one, counts.
  EXPECT_THAT(Http("GET", "/v1/caller", cookie + Bearer(viewer_)).body, HasSubstr(R"("name":"vera")"));
  {
    EventStream stream(http_->address(), "/v1/" + job + ":watch", true, cookie);
    EXPECT_EQ(stream.head().code, 200);
    StreamEvent event;
    EXPECT_TRUE(stream.Read(&event));
  }
  EXPECT_EQ(Http("POST", "/v1/" + job + ":pause", cookie + OwnOrigin(), "{}").code, 200);
  const Reply out = Http("DELETE", "/v1/session", cookie + OwnOrigin());
  EXPECT_EQ(out.code, 204);
  EXPECT_THAT(out.headers.at("set-cookie"), HasSubstr("Max-Age=0"));
  const Reply ended = Http("GET", "/v1/caller", cookie);
  EXPECT_EQ(ended.code, 401);
  EXPECT_THAT(ended.headers.at("set-cookie"), HasSubstr("Max-Age=0"));
}

TEST_F(AccessApiTest, AnotherPageCannotUseTheCookie) {
  const std::string cookie = LogIn(ana_);
  const std::string job = CreateJobAs("ana");
  for (const std::string origin : {"", "Origin: https://example.org\r\n", "Origin: null\r\n"}) {
    EXPECT_EQ(Http("POST", "/v1/" + job + ":cancel", cookie + origin, "{}").code, 403) << origin;
    EXPECT_EQ(Http("DELETE", "/v1/session", cookie + origin).code, 403) << origin;
  }
  // Nor can a form, which cannot say that it is JSON.
  const Reply form =
      HttpClient(http_->address())
          .Call("POST", "/v1/" + job + ":cancel", "{}", cookie + OwnOrigin() + "Content-Type: text/plain\r\n");
  EXPECT_EQ(form.code, 415);
  EXPECT_EQ(HttpClient(http_->address())
                .Call("POST", "/v1/session", R"({"token": ")" + ana_ + "\"}", "Content-Type: text/plain\r\n")
                .code,
            415);
  EXPECT_EQ(Http("GET", "/v1/caller", cookie).code, 200);  // it is still logged in
}

TEST_F(AccessApiTest, ALogInThatFailsDoesNotRepeatWhatItWasGiven) {
  for (const std::string& body : {std::string(R"({"token": "orb_wrong"})"), std::string(R"({"token" "orb_wrong"})"),
                                  std::string(R"({"tokens": "orb_wrong"})"), std::string("orb_wrong")}) {
    const Reply reply = Http("POST", "/v1/session", "", body);
    EXPECT_TRUE(reply.code == 401 || reply.code == 400) << reply.code;
    EXPECT_THAT(reply.body, Not(HasSubstr("orb_wrong")));
    EXPECT_EQ(reply.headers.count("set-cookie"), 0u);
  }
  EXPECT_EQ(Http("POST", "/v1/session", "", "{}").code, 400);
  EXPECT_EQ(Http("GET", "/v1/session").code, 405);
}

TEST_F(AccessApiTest, WhoGuessesIsToldToWait) {
  Reply reply;
  for (int i = 0; i < 2 * kFailures && reply.code != 429; ++i) reply = Http("GET", "/v1/jobs", Bearer("orb_guess"));
  ASSERT_EQ(reply.code, 429);
  EXPECT_EQ(reply.headers.count("retry-after"), 1u);
  EXPECT_THAT(reply.body, HasSubstr("TOO_MANY_FAILURES"));
  const grpc::Status status = Rpc(*api_->methods().Find("orbitune.v1.TuningService.ListJobs"), "orb_guess");
  EXPECT_EQ(DetailsOf(status).retry, status.error_code() == StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(Http("GET", "/v1/jobs", Bearer(viewer_)).code, 200);
}

TEST_F(AccessApiTest, StreamsEndWithTheTokenThatOpenedThem) {
  const std::string job = CreateJobAs("ana");
  grpc::ClientContext context;
  context.AddMetadata("authorization", "Bearer " + viewer_);
  v1::WatchJobRequest request;
  request.set_name(job);
  const auto reader = client_->tuning().WatchJob(&context, request);
  v1::WatchJobResponse event;
  ASSERT_TRUE(reader->Read(&event));
  EventStream stream(http_->address(), "/v1/" + job + ":watch", true, Bearer(viewer_));
  ASSERT_EQ(stream.head().code, 200);
  EventStream others(http_->address(), "/v1/" + job + ":watch", true, Bearer(bob_));
  ASSERT_TRUE(console_->RevokeTokens("vera", NowUs()).ok());
  while (reader->Read(&event)) {
  }
  const grpc::Status status = reader->Finish();
  EXPECT_EQ(status.error_code(), StatusCode::UNAUTHENTICATED);
  EXPECT_EQ(DetailsOf(status).reason, "TOKEN_REVOKED");
  ExpectLastWord(stream, "TOKEN_REVOKED");
  StreamEvent of_another;
  EXPECT_TRUE(others.Read(&of_another));
}

TEST_F(AccessApiTest, StreamsEndWithTheSessionThatOpenedThem) {
  const std::string target = "/v1/" + CreateJobAs("ana") + ":watch";
  const std::string cookie = LogIn(ana_);
  const std::string other_cookie = LogIn(ana_);
  EventStream sse(http_->address(), target, true, cookie);
  EventStream lines(http_->address(), target, false, cookie);
  EventStream of_the_token(http_->address(), target, true, Bearer(ana_));
  EventStream of_the_other(http_->address(), target, false, other_cookie);
  EXPECT_EQ(Http("DELETE", "/v1/session", cookie + OwnOrigin()).code, 204);
  ExpectLastWord(sse, "SESSION_ENDED");
  ExpectLastWord(lines, "SESSION_ENDED");
  EXPECT_EQ(HttpClient(http_->address()).Get(target, cookie).code, 401);
  EXPECT_EQ(Http("GET", "/v1/caller", other_cookie).code, 200);
  // Those that are left end with the token, and so does its session.
  ASSERT_TRUE(console_->RevokeTokens("ana", NowUs()).ok());
  ExpectLastWord(of_the_token, "TOKEN_REVOKED");
  ExpectLastWord(of_the_other, "TOKEN_REVOKED");
}

TEST_F(AccessApiTest, AStreamEndsWhenItsTokenExpires) {
  const std::string job = CreateJobAs("ana");
  bool opened = false;
  for (std::int64_t time_s = 1; !opened; time_s *= 2) {  // long enough to open a stream with
    const std::string brief = AddToken("brief", Role::kViewer, NowUs() + time_s * 1'000'000);
    while (absl::StrContains(Http("GET", "/v1/caller", Bearer(brief)).body, "TOKEN_INVALID")) {  // not noticed yet
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    EventStream stream(http_->address(), "/v1/" + job + ":watch", true, Bearer(brief));
    opened = stream.head().code == 200;
    if (opened) ExpectLastWord(stream, "TOKEN_EXPIRED");
  }
}

TEST_F(AccessApiTest, WhatIsChangedAndWhatIsRefusedIsInTheAuditLog) {
  const std::string before = CreateJobAs("ana");
  const Reply created = Http("POST", "/v1/jobs", Bearer(ana_) + "X-Request-Id: night-shift-7\r\n",
                             ToJson(CreateRequest(SearchOptions::kMaxIterations).job()));
  ASSERT_EQ(created.code, 200) << created.body;
  v1::Job job;
  ASSERT_TRUE(FromJson(created.body, &job).ok());
  // It was there before the answer was.
  const auto entries = Entries();
  ASSERT_EQ(entries.size(), 1u);
  EXPECT_EQ(entries[0].caller, "ana");
  EXPECT_EQ(entries[0].method, "orbitune.v1.TuningService.CreateJob");
  EXPECT_EQ(entries[0].resource, job.name());
  EXPECT_EQ(entries[0].outcome, "OK");
  EXPECT_EQ(entries[0].request_id, "night-shift-7");
  EXPECT_EQ(entries[0].peer, "127.0.0.1");
  // Reads and trials are not.
  EXPECT_EQ(Http("GET", "/v1/jobs", Bearer(ana_)).code, 200);
  EXPECT_EQ(Http("POST", "/v1/jobs?validate_only=true", Bearer(ana_), ToJson(CreateRequest(3).job())).code, 200);
  EXPECT_EQ(Http("POST", "/v1/" + before + ":cancel", Bearer(bob_), "{}").code, 403);
  const AuditEntry refused = WaitForEntry([](const AuditEntry& entry) { return entry.outcome == "PERMISSION_DENIED"; });
  EXPECT_EQ(refused.caller, "bob");
  EXPECT_EQ(refused.resource, before);
  EXPECT_EQ(Http("GET", "/v1/jobs").code, 401);
  const AuditEntry unknown = WaitForEntry([](const AuditEntry& entry) { return entry.outcome == "UNAUTHENTICATED"; });
  EXPECT_EQ(unknown.caller, "");
  EXPECT_EQ(unknown.method, "orbitune.v1.TuningService.ListJobs");

  v1::ListAuditEntriesResponse page;
  ASSERT_TRUE(FromJson(Http("GET", "/v1/auditEntries?page_size=2", Bearer(admin_)).body, &page).ok());
  ASSERT_EQ(page.entries_size(), 2);
  EXPECT_EQ(page.entries(0).resource(), job.name());
  v1::ListAuditEntriesResponse rest;
  ASSERT_TRUE(
      FromJson(Http("GET", "/v1/auditEntries?page_token=" + page.next_page_token(), Bearer(admin_)).body, &rest).ok());
  EXPECT_EQ(rest.entries(0).number(), page.entries(1).number() + 1);
  const std::string future = Http("GET", "/v1/auditEntries?since=2100-01-01T00:00:00Z", Bearer(admin_)).body;
  v1::ListAuditEntriesResponse none;
  ASSERT_TRUE(FromJson(future, &none).ok()) << future;
  EXPECT_EQ(none.entries_size(), 0);
}

}  // namespace
}  // namespace orbitune::server_test
