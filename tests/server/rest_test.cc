// REST through real sockets, against a server in this process: every route, every kind of error, hostile input.
#include <gmock/gmock.h>
#include <google/protobuf/field_mask.pb.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "server/api/json.h"
#include "server/rest/openapi.h"
#include "server/rest/routes.h"
#include "server/rest/transcode.h"
#include "tests/server/rest_support.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using Json = nlohmann::json;
using Reply = HttpClient::Reply;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

class RestTest : public RpcServerTest {
 protected:
  RestTest() { Start({}); }
  ~RestTest() override {
    if (http_ != nullptr) http_->Shutdown(std::chrono::seconds(2));
  }

  void Start(HttpOptions options) {
    options.address = "127.0.0.1:0";
    options.web_dir = directory_.File("web");
    options.log = [](const std::string&) {};
    auto http = HttpServer::Start(std::move(options), api_);
    ASSERT_TRUE(http.ok()) << http.status();
    http_ = *std::move(http);
  }

  Reply Get(const std::string& target, const std::string& headers = "") {
    return HttpClient(http_->address()).Get(target, headers);
  }
  Reply Post(const std::string& target, const std::string& json) {
    return HttpClient(http_->address()).Post(target, json);
  }
  Reply Call(const std::string& method, const std::string& target, const std::string& body = "",
             const std::string& headers = "") {
    return HttpClient(http_->address()).Call(method, target, body, headers);
  }
  // Sends what may be no request at all, and takes what comes.
  Reply Raw(const std::string& bytes) {
    HttpClient client(http_->address());
    client.Send(bytes);
    return client.ReadReply();
  }
  template <typename Message>
  Message Parsed(const Reply& reply) {
    EXPECT_EQ(reply.code, 200) << reply.body;
    Message message;
    EXPECT_TRUE(FromJson(reply.body, &message).ok()) << reply.body;
    return message;
  }
  void WriteFile(const std::string& name, const std::string& text) {
    const std::filesystem::path path = directory_.File("web/" + name);
    std::filesystem::create_directories(path.parent_path());
    std::ofstream(path) << text;
  }

  std::unique_ptr<HttpServer> http_;
};

std::string Unpacked(std::string packed) {
  std::string text(10'000'000, '\0');
  z_stream stream = {};
  EXPECT_EQ(inflateInit2(&stream, MAX_WBITS + 16), Z_OK);
  stream.next_in = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_in = static_cast<uInt>(packed.size());
  stream.next_out = reinterpret_cast<Bytef*>(text.data());
  stream.avail_out = static_cast<uInt>(text.size());
  EXPECT_EQ(inflate(&stream, Z_FINISH), Z_STREAM_END);
  text.resize(stream.total_out);
  inflateEnd(&stream);
  return text;
}

// {"error": {...}} with all its parts.
Json ErrorOf(const Reply& reply) {
  EXPECT_EQ(reply.headers.at("content-type"), "application/json");
  const Json body = Json::parse(reply.body, nullptr, false);
  EXPECT_TRUE(body.is_object()) << reply.body;
  const Json error = body.value("error", Json::object());
  EXPECT_EQ(error.value("code", 0), reply.code);
  for (const char* part : {"status", "message", "details"}) EXPECT_TRUE(error.contains(part)) << reply.body;
  return error;
}

TEST_F(RestTest, EveryMethodHasARoute) {
  const rest::RouteTable routes(api_.methods());
  for (const auto& [name, method] : api_.methods().all()) {
    EXPECT_TRUE(std::ranges::any_of(routes.all(), [&](const rest::Route& route) { return route.method == &method; }))
        << name;
  }
}

TEST_F(RestTest, TheRoutesAnswerAsGrpcDoes) {
  const std::string body = ToJson(CreateRequest(12).job());
  const v1::Job valid = Parsed<v1::Job>(Post("/v1/jobs?validate_only=true&request_id=a%20b", body));
  EXPECT_EQ(valid.name(), "");
  const v1::Job job = Parsed<v1::Job>(Post("/v1/jobs?requestId=one", body));
  EXPECT_EQ(Parsed<v1::Job>(Post("/v1/jobs?request_id=one", body)).name(), job.name());
  client_->WaitForEnd(job.name());

  EXPECT_EQ(Get("/v1/" + job.name()).body, ToJson(client_->Get(job.name())) + "\n");
  EXPECT_EQ(Get("/v1/" + job.name() + "/iterations").body, ToJson(client_->Iterations(job.name())) + "\n");
  const auto page = Parsed<v1::ListIterationsResponse>(Get("/v1/" + job.name() + "/iterations?page_size=5"));
  EXPECT_EQ(page.iterations_size(), 5);
  const auto next = Parsed<v1::ListIterationsResponse>(
      Get("/v1/" + job.name() + "/iterations?page_size=5&page_token=" + page.next_page_token()));
  EXPECT_EQ(next.iterations(0).iteration(), 6);
  const std::string iterations = "/v1/" + job.name() + "/iterations";
  EXPECT_EQ(Get(iterations + "?max_points=16").body, Get(iterations).body);
  EXPECT_THAT(Get(iterations + "?max_points=16&page_size=5").body, HasSubstr("\"field\":\"max_points\""));
  EXPECT_THAT(Get(iterations + "?first_iteration=2").body, HasSubstr("\"field\":\"max_points\""));
  EXPECT_EQ(Parsed<v1::ListJobsResponse>(Get("/v1/jobs?filter=state+%3D+SUCCEEDED&order_by=best_cost")).jobs_size(), 1);
  EXPECT_EQ(Parsed<v1::ListJobsResponse>(Get("/v1/jobs?filter=state%20=%20FAILED")).jobs_size(), 0);

  EXPECT_GE(Parsed<v1::ListScenariosResponse>(Get("/v1/scenarios")).scenarios_size(), 2);
  EXPECT_EQ(Parsed<v1::Scenario>(Get("/v1/scenarios/gto-geo")).name(), "scenarios/gto-geo");
  v1::SimulateEpisodeRequest episode;
  *episode.mutable_scenario_definition() = SmallDefinition(1);
  episode.set_include_trajectory(true);
  v1::SimulateEpisodeResponse expected;
  grpc::ClientContext context;
  ASSERT_TRUE(client_->simulation().SimulateEpisode(&context, episode, &expected).ok());
  EXPECT_EQ(Post("/v1/episodes:simulate", ToJson(episode)).body, ToJson(expected) + "\n");

  EXPECT_EQ(Call("DELETE", "/v1/" + job.name()).body, "{}\n");
  EXPECT_EQ(Get("/v1/" + job.name()).code, 404);
}

TEST_F(RestTest, LongAnswersArePackedForWhoeverTakesThem) {
  const Reply plain = Get("/v1/scenarios", "Accept-Encoding: identity\r\n");
  EXPECT_FALSE(plain.headers.contains("content-encoding"));
  const Reply packed = Get("/v1/scenarios", "Accept-Encoding: br, gzip;q=0.5\r\n");
  EXPECT_EQ(packed.headers.at("content-encoding"), "gzip");
  EXPECT_EQ(packed.headers.at("vary"), "Accept-Encoding");
  EXPECT_LT(packed.body.size(), plain.body.size() / 2);
  EXPECT_EQ(Unpacked(packed.body), plain.body);
  EXPECT_FALSE(Get("/v1/jobs", "Accept-Encoding: gzip\r\n").headers.contains("content-encoding")) << "a short one";
}

TEST_F(RestTest, TransitionsAreOneCallEach) {
  const std::string name =
      Parsed<v1::Job>(Post("/v1/jobs", ToJson(CreateRequest(SearchOptions::kMaxIterations).job()))).name();
  const v1::Job paused = Parsed<v1::Job>(Post("/v1/" + name + ":pause", ""));
  EXPECT_EQ(paused.state(), v1::JOB_STATE_PAUSED);
  EXPECT_EQ(ErrorOf(Post("/v1/" + name + ":resume", R"({"etag":"wrong"})")).at("status"), "ABORTED");
  EXPECT_EQ(Parsed<v1::Job>(Post("/v1/" + name + ":resume", "{\"etag\":\"" + paused.etag() + "\"}")).name(), name);
  EXPECT_EQ(ErrorOf(Call("DELETE", "/v1/" + name)).at("details").at(0).at("reason"), "JOB_STATE");
  // The path names the job, whatever the body says.
  EXPECT_EQ(Parsed<v1::Job>(Post("/v1/" + name + ":cancel", R"({"name":"jobs/other"})")).state(),
            v1::JOB_STATE_CANCELLED);
  EXPECT_EQ(Call("DELETE", "/v1/" + name + "?etag=wrong").code, 409);
  EXPECT_EQ(Call("DELETE", "/v1/" + name).code, 200);
}

TEST_F(RestTest, ErrorsAreCanonical) {
  struct Case {
    Reply reply;
    int code;
    std::string status;
    std::string field;  // of the first violation; empty: none
    std::string message;
  };
  const std::string gto = R"("scenario":"scenarios/gto-geo")";
  const std::vector<Case> cases = {
      {Get("/v1/jobs/none"), 404, "NOT_FOUND", "", "none"},
      {Get("/v1/nothing"), 404, "NOT_FOUND", "", "openapi"},
      {Get("/v1/jobs/"), 404, "NOT_FOUND", "", ""},
      {Get("/v1/jobs/a/b"), 404, "NOT_FOUND", "", ""},
      {Get("/v1/jobs/a:b"), 404, "NOT_FOUND", "", ""},
      {Get("/v1/jobs?page_size=-1"), 400, "INVALID_ARGUMENT", "page_size", "got -1"},
      {Get("/v1/jobs?page_size=x"), 400, "INVALID_ARGUMENT", "page_size", "got \"x\""},
      {Get("/v1/jobs?page_size=99999999999"), 400, "INVALID_ARGUMENT", "page_size", "2147483647"},
      {Get("/v1/jobs?page_size=1&page_size=2"), 400, "INVALID_ARGUMENT", "page_size", "once"},
      {Get("/v1/jobs?pagesize=1"), 400, "INVALID_ARGUMENT", "pagesize", "a field"},
      {Get("/v1/jobs/x?name=jobs/y"), 400, "INVALID_ARGUMENT", "name", "the path"},
      {Get("/v1/jobs?filter=%zz"), 400, "INVALID_ARGUMENT", "", "percent-encoding"},
      {Get("/v1/jobs?filter=%ff"), 400, "INVALID_ARGUMENT", "", "UTF-8"},
      {Post("/v1/jobs", "{"), 400, "INVALID_ARGUMENT", "job", ""},
      {Post("/v1/jobs", "[]"), 400, "INVALID_ARGUMENT", "job", ""},
      {Post("/v1/jobs", "\xff\xfe"), 400, "INVALID_ARGUMENT", "job", ""},
      {Post("/v1/jobs", std::string(200'000, '[')), 400, "INVALID_ARGUMENT", "job", ""},
      {Post("/v1/jobs", R"({"nonsense":1})"), 400, "INVALID_ARGUMENT", "job", "nonsense"},
      {Post("/v1/jobs", R"({"hyperparameters":{"iterations":"many"}})"), 400, "INVALID_ARGUMENT",
       "job.hyperparameters.iterations", "many"},
      {Post("/v1/jobs", "{" + gto + R"(,"hyperparameters":{"step_size":-1}})"), 400, "INVALID_ARGUMENT",
       "job.hyperparameters.step_size", "got -1"},
      {Post("/v1/jobs?job.display_name=x", "{}"), 400, "INVALID_ARGUMENT", "job.display_name", "body"},
      {Post("/v1/episodes:simulate", R"({"sample_stride":"x"})"), 400, "INVALID_ARGUMENT", "sample_stride", "x"},
      {Call("DELETE", "/v1/jobs/x", "{}", "Content-Type: application/json\r\n"), 400, "INVALID_ARGUMENT", "body", ""},
      {Call("POST", "/v1/jobs", "a=b", "Content-Type: application/x-www-form-urlencoded\r\n"), 415, "INVALID_ARGUMENT",
       "", "application/json"},
      {Call("POST", "/v1/jobs", "{}"), 415, "INVALID_ARGUMENT", "", "Content-Type"},
      {Call("POST", "/v1/jobs", "{}", "Content-Type: text/plain\r\n"), 415, "INVALID_ARGUMENT", "", "text/plain"},
      {Call("PUT", "/v1/jobs"), 405, "UNIMPLEMENTED", "", "POST"},
      {Call("BREW", "/v1/jobs"), 405, "UNIMPLEMENTED", "", "POST"},
      {Call("GET", "/v1/jobs/x:cancel"), 405, "UNIMPLEMENTED", "", "POST"},
      {Call("POST", "/healthz"), 405, "UNIMPLEMENTED", "", "GET"},
      {Call("POST", "/"), 405, "UNIMPLEMENTED", "", "GET"},
  };
  for (const Case& c : cases) {
    EXPECT_EQ(c.reply.code, c.code) << c.reply.body;
    const Json error = ErrorOf(c.reply);
    EXPECT_EQ(error.at("status"), c.status) << c.reply.body;
    EXPECT_THAT(error.at("message").get<std::string>(), HasSubstr(c.message));
    EXPECT_EQ(c.reply.headers.at("x-content-type-options"), "nosniff");
    if (c.field.empty()) continue;
    ASSERT_FALSE(error.at("details").empty()) << c.reply.body;
    EXPECT_EQ(error.at("details").at(0).at("@type"), "type.googleapis.com/google.rpc.BadRequest");
    EXPECT_EQ(error.at("details").at(0).at("field_violations").at(0).at("field"), c.field) << c.reply.body;
  }
  EXPECT_EQ(Call("PUT", "/v1/jobs").headers.at("allow"), "POST, GET, HEAD");
}

TEST_F(RestTest, HeadHasTheHeadersOnly) {
  HttpClient client(http_->address());
  for (const char* path : {"/v1/scenarios", "/", "/openapi.json", "/healthz"}) {
    const Reply get = client.Get(path);
    const Reply head = client.Call("HEAD", path);  // on the same connection: a body would come before the next reply
    EXPECT_EQ(head.code, 200);
    EXPECT_EQ(head.headers.at("content-length"), std::to_string(get.body.size()));
    EXPECT_EQ(head.headers.at("content-type"), get.headers.at("content-type"));
  }
  EXPECT_EQ(client.Call("HEAD", "/v1/jobs/none").code, 404);
}

TEST(TranscodeTest, SetsFieldsFromText) {
  v1::CreateJobRequest request;
  EXPECT_TRUE(rest::SetField(&request, "job.hyperparameters.seed", "18446744073709551615").ok());
  EXPECT_EQ(request.job().hyperparameters().seed(), 18446744073709551615u);
  EXPECT_TRUE(rest::SetField(&request, "job.hyperparameters.stepSize", "1e-3").ok());
  EXPECT_EQ(request.job().hyperparameters().step_size(), 1e-3);
  EXPECT_TRUE(rest::SetField(&request, "job.state", "JOB_STATE_PAUSED").ok());
  EXPECT_EQ(request.job().state(), v1::JOB_STATE_PAUSED);
  EXPECT_TRUE(rest::SetField(&request, "job.create_time", "2024-02-29T00:00:00Z").ok());
  EXPECT_EQ(request.job().create_time().seconds(), 1709164800);
  EXPECT_TRUE(rest::SetField(&request, "validate_only", "true").ok());
  EXPECT_TRUE(rest::SetField(&request, "validate_only", "false").ok());
  EXPECT_FALSE(request.validate_only());
  EXPECT_TRUE(rest::SetField(&request, "request_id", "\"quoted\\\n\x01").ok());
  EXPECT_EQ(request.request_id(), "\"quoted\\\n\x01");
  for (const auto& [path, value] :
       std::vector<std::pair<std::string, std::string>>{{"", "x"},
                                                        {".", "x"},
                                                        {"job", "{}"},
                                                        {"job.labels", "x"},
                                                        {"job.none", "x"},
                                                        {"job.labels.key", "x"},
                                                        {"request_id.x", "x"},
                                                        {"validate_only", "yes"},
                                                        {"job.state", "NOT_A_STATE"},
                                                        {"job.create_time", "yesterday"},
                                                        {"job.hyperparameters.seed", "-1"},
                                                        {"job.hyperparameters.step_size", ""}}) {
    const absl::Status status = rest::SetField(&request, path, value);
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << path;
    EXPECT_EQ(ViolatedFields(status).size(), 1u) << path;
  }
  google::protobuf::FieldMask repeated;
  EXPECT_TRUE(rest::SetField(&repeated, "paths", "a").ok());
  EXPECT_TRUE(rest::SetField(&repeated, "paths", "b").ok());
  EXPECT_EQ(repeated.paths_size(), 2);
}

TEST(PathTemplateTest, TakesTemplatesApart) {
  const rest::PathTemplate path = rest::ParsePathTemplate("/v1/{parent=users/*/boxes/*}/items/{item}/{rest=**}:do");
  EXPECT_EQ(path.segments.size(), 8u);
  EXPECT_EQ(path.verb, "do");
  ASSERT_EQ(path.variables.size(), 3u);
  EXPECT_EQ(path.variables[0].field, "parent");
  EXPECT_EQ(path.variables[0].end - path.variables[0].begin, 4u);
  EXPECT_EQ(path.variables[1].field, "item");
  EXPECT_EQ(rest::OpenApiPath(path), "/v1/users/{id}/boxes/{id_2}/items/{id_3}/{id_4}:do");
}

// What of `value` is not as `schema` says.
std::string SchemaFault(const Json& document, Json schema, const Json& value) {
  if (schema.contains("$ref")) {
    schema = document.at(Json::json_pointer(schema.at("$ref").get<std::string>().substr(1)));
  }
  if (schema.contains("allOf")) return SchemaFault(document, schema["allOf"].at(0), value);
  const std::string type = schema.at("type");
  const bool right = type == "object"    ? value.is_object()
                     : type == "array"   ? value.is_array()
                     : type == "string"  ? value.is_string()
                     : type == "boolean" ? value.is_boolean()
                     : type == "integer" ? value.is_number_integer()
                                         : value.is_number();
  if (!right) return value.dump() + " is no " + type;
  if (schema.contains("enum") && std::ranges::find(schema["enum"], value) == schema["enum"].end()) {
    return value.dump() + " is not in its enum";
  }
  if (type == "array") {
    for (const Json& item : value) {
      if (std::string fault = SchemaFault(document, schema["items"], item); !fault.empty()) return fault;
    }
  }
  if (type != "object") return "";
  for (const auto& [name, member] : value.items()) {
    Json of = schema.value("properties", Json::object()).value(name, Json());
    if (of.is_null()) of = schema.value("additionalProperties", Json(false));
    if (of == true) continue;
    if (!of.is_object()) return name + " is not described";
    if (std::string fault = SchemaFault(document, of, member); !fault.empty()) return name + ": " + fault;
  }
  return "";
}

TEST_F(RestTest, OpenApiDescribesTheLiveServer) {
  const std::string id = client_->Create(3).substr(5);
  client_->WaitForEnd("jobs/" + id);
  const Json document = Json::parse(Get("/openapi.json").body);
  EXPECT_EQ(document.at("openapi"), "3.0.3");
  std::size_t operations = 0;
  for (const auto& [path, methods] : document.at("paths").items()) {
    for (const auto& [method, operation] : methods.items()) {
      ++operations;
      if (method == "delete") continue;  // the job is needed
      std::string target = path;
      const std::string value = path.starts_with("/v1/jobs") ? id : "gto-geo";
      for (std::size_t at; (at = target.find("{id}")) != target.npos;) target.replace(at, 4, value);
      std::string http_method = method;
      std::ranges::transform(http_method, http_method.begin(), [](unsigned char c) { return std::toupper(c); });
      const std::string body = path == "/v1/jobs"                ? ToJson(CreateRequest(2).job())
                               : path == "/v1/episodes:simulate" ? R"({"scenario":"scenarios/gto-geo"})"
                                                                 : "{}";
      const Reply reply = Call(http_method, target, operation.contains("requestBody") ? body : "",
                               "Content-Type: application/json\r\n");
      // There may be no such resource; the path there is.
      EXPECT_THAT(reply.body, Not(HasSubstr("there is nothing at this path"))) << target;
      EXPECT_NE(reply.code, 405) << target;
      const Json& responses = operation.at("responses");
      const Json& described = responses.at(reply.code == 200 ? "200" : "default").at("content");
      ASSERT_TRUE(described.contains(reply.headers.at("content-type"))) << target;
      const Json& schema = described.at(reply.headers.at("content-type")).at("schema");
      const std::string first_line = reply.body.substr(0, reply.body.find('\n'));
      EXPECT_EQ(SchemaFault(document, schema, Json::parse(first_line)), "") << target;
      // What is not described is refused.
      if (method == "get") {
        EXPECT_EQ(Get(target + "?not_described=1").code, 400) << target;
      }
    }
  }
  EXPECT_EQ(operations, rest::RouteTable(api_.methods()).all().size() + 2);  // and the session's
}

TEST_F(RestTest, OpenApiSaysWhatTheProtoSays) {
  const Json document = Json::parse(Get("/openapi.json").body);
  const Json& paths = document.at("paths");
  EXPECT_EQ(paths.at("/v1/jobs/{id}:cancel").at("post").at("description"),
            "QUEUED, RUNNING or PAUSED to CANCELLED; what was stored stays.");
  const Json& schemas = document.at("components").at("schemas");
  EXPECT_EQ(schemas.at("Job").at("properties").at("report").at("description"), "once SUCCEEDED");
  EXPECT_THAT(paths.at("/v1/jobs/{id}:watch").dump(), HasSubstr("nothing is dropped"));
  EXPECT_THAT(document.at("tags").dump(), HasSubstr("Tuning jobs: create, follow, steer"));
}

TEST_F(RestTest, HealthAndReadiness) {
  EXPECT_EQ(Get("/healthz").body, "ok\n");
  EXPECT_EQ(Get("/readyz").code, 200);
  http_->SetServing(absl::UnavailableError("the disk is full"));
  EXPECT_EQ(Get("/healthz").code, 200);
  const Reply reply = Get("/readyz");
  EXPECT_EQ(reply.code, 503);
  EXPECT_EQ(ErrorOf(reply).at("message"), "the disk is full");
  EXPECT_EQ(ErrorOf(reply).at("details").at(0).at("@type"), "type.googleapis.com/google.rpc.RetryInfo");
  EXPECT_EQ(reply.headers.at("retry-after"), "1");
  http_->SetServing(absl::OkStatus());
  EXPECT_EQ(Get("/readyz").code, 200);
}

TEST_F(RestTest, PagesFromElsewhereAreRefusedUnlessNamed) {
  const std::string json = "Content-Type: application/json\r\n";
  EXPECT_EQ(Call("POST", "/v1/jobs/x:cancel", "{}", json + "Origin: http://evil.example\r\n").code, 403);
  EXPECT_EQ(Call("POST", "/v1/jobs/x:cancel", "", "Origin: null\r\n").code, 403);
  EXPECT_EQ(Call("POST", "/v1/jobs/x:cancel", "{}", json + "Origin: http://localhost\r\n").code, 404);
  const Reply read = Get("/v1/scenarios", "Origin: http://evil.example\r\n");
  EXPECT_EQ(read.code, 200);
  EXPECT_FALSE(read.headers.contains("access-control-allow-origin"));
  EXPECT_FALSE(Call("OPTIONS", "/v1/jobs", "", "Origin: http://evil.example\r\n")
                   .headers.contains("access-control-allow-methods"));
  // A name that a page's own server has pointed here.
  EXPECT_EQ(Raw("GET /v1/jobs HTTP/1.1\r\nHost: evil.example:7314\r\n\r\n").code, 403);
  for (const char* host : {"127.0.0.1:7314", "[::1]:7314", "localhost:1", "LOCALHOST", "10.0.0.1"}) {
    EXPECT_EQ(Raw(std::string("GET /v1/jobs HTTP/1.1\r\nHost: ") + host + "\r\n\r\n").code, 200) << host;
  }
}

TEST_F(RestTest, CorsForTheOriginsThatAreNamed) {
  http_.reset();
  Start({.cors_origins = {"https://board.example"}});
  const std::string origin = "Origin: https://board.example\r\n";
  const Reply read = Get("/v1/scenarios", origin);
  EXPECT_EQ(read.headers.at("access-control-allow-origin"), "https://board.example");
  EXPECT_EQ(read.headers.at("vary"), "Origin");
  const Reply preflight = Call("OPTIONS", "/v1/jobs", "", origin + "Access-Control-Request-Method: POST\r\n");
  EXPECT_EQ(preflight.code, 204);
  EXPECT_EQ(preflight.headers.at("access-control-allow-methods"), "POST, GET, HEAD");
  EXPECT_THAT(preflight.headers.at("access-control-allow-headers"), HasSubstr("Content-Type"));
  EXPECT_EQ(Call("POST", "/v1/jobs/x:cancel", "", origin).code, 404);
  EXPECT_EQ(Call("POST", "/v1/jobs/x:cancel", "", "Origin: https://other.example\r\n").code, 403);
  EXPECT_FALSE(
      Get("/v1/scenarios", "Origin: https://other.example\r\n").headers.contains("access-control-allow-origin"));
  EXPECT_EQ(Raw("GET /v1/jobs HTTP/1.1\r\nHost: board.example\r\n\r\n").code, 200);
}

TEST_F(RestTest, WithoutADashboardThePageSaysHowToBuildIt) {
  const Reply page = Get("/");
  EXPECT_EQ(page.code, 200);
  EXPECT_THAT(page.body, HasSubstr("npm run build"));
  EXPECT_EQ(page.headers.at("content-type"), "text/html; charset=utf-8");
  EXPECT_EQ(Get("/index.html").code, 404);
}

TEST_F(RestTest, ServesTheDashboardsFiles) {
  WriteFile("index.html", "<p>page");
  WriteFile("assets/app.js", "script");
  WriteFile("assets/app.js.gz", "zipped");
  WriteFile("assets/app.js.br", "brotli");
  WriteFile("style.css", "p {}");
  WriteFile("picture.svg", "<svg/>");
  WriteFile(".secret", "secret");
  std::ofstream(directory_.File("outside.txt")) << "outside";
  const Reply page = Get("/");
  EXPECT_EQ(page.body, "<p>page");
  EXPECT_THAT(page.headers.at("content-security-policy"), HasSubstr("default-src 'none'; script-src 'self'"));
  EXPECT_THAT(page.headers.at("content-security-policy"), Not(HasSubstr("unsafe")));
  EXPECT_EQ(page.headers.at("cache-control"), "no-cache");
  EXPECT_EQ(page.headers.at("x-content-type-options"), "nosniff");
  const Reply again = Get("/", "If-None-Match: \"other\", " + page.headers.at("etag") + "\r\n");
  EXPECT_EQ(again.code, 304);
  EXPECT_EQ(again.headers.at("etag"), page.headers.at("etag"));
  EXPECT_EQ(Get("/style.css").headers.at("content-type"), "text/css; charset=utf-8");
  EXPECT_EQ(Get("/picture.svg").headers.at("content-type"), "image/svg+xml");
  EXPECT_EQ(Get("/jobs/abc", "Accept: text/html,*/*\r\n").body, "<p>page");
  EXPECT_EQ(Get("/jobs/abc").code, 404);

  const Reply plain = Get("/assets/app.js");
  EXPECT_EQ(plain.body, "script");
  EXPECT_EQ(plain.headers.at("content-type"), "text/javascript; charset=utf-8");
  EXPECT_FALSE(plain.headers.contains("content-encoding"));
  const Reply zipped = Get("/assets/app.js", "Accept-Encoding: gzip, br;q=0\r\n");
  EXPECT_EQ(zipped.body, "zipped");
  EXPECT_EQ(zipped.headers.at("content-encoding"), "gzip");
  EXPECT_EQ(zipped.headers.at("content-type"), "text/javascript; charset=utf-8");
  EXPECT_EQ(zipped.headers.at("vary"), "Accept-Encoding");
  EXPECT_NE(zipped.headers.at("etag"), plain.headers.at("etag"));
  EXPECT_EQ(Get("/assets/app.js", "Accept-Encoding: gzip, deflate, br\r\n").body, "brotli");

  for (const char* path : {"/../outside.txt", "/%2e%2e/outside.txt", "/..%2foutside.txt", "/assets/../../outside.txt",
                           "/assets/..%2f..%2foutside.txt", "/.%2e/outside.txt", "/..\\outside.txt", "//outside.txt",
                           "/assets//app.js", "/./style.css", "/.secret", "/assets", "/assets/", "/%00", "/a%00.css",
                           "/style.css%00.html", "/style.css/", "/%", "/%e0%80%ae"}) {
    const Reply reply = Get(path, "Accept: text/html\r\n");
    EXPECT_THAT(reply.code, AnyOf(400, 404, 200)) << path;
    EXPECT_THAT(reply.body, Not(AnyOf(HasSubstr("outside"), HasSubstr("secret"), HasSubstr("script")))) << path;
    EXPECT_THAT(Get(path).code, AnyOf(400, 404)) << path;
  }
}

TEST_F(RestTest, WhatIsNoHttpIsRefusedAndHarmsNobody) {
  const std::vector<std::string> cases = {
      "\r\n\r\n\r\n",
      "GET\r\n\r\n",
      "GET / HTTP/9.9\r\n\r\n",
      "GET / HTTP/1.1\r\n\r\n",                        // no Host
      "GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",  // two
      "GET / HTTP/1.1\r\nHost localhost\r\n\r\n",      // no colon
      "GET / HTTP/1.1\r\nHost: localhost\r\n folded: x\r\n: x\r\n\r\n",
      "GET  /  HTTP/1.1\r\nHost: localhost\r\n\r\n",
      "GET http:// HTTP/1.1\r\nHost: localhost\r\n\r\n",
      "GET * HTTP/1.1\r\nHost: localhost\r\n\r\n",
      "CONNECT localhost:80 HTTP/1.1\r\nHost: localhost\r\n\r\n",
      "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: x\r\n\r\n",
      "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: -5\r\n\r\n",
      "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999999999999999999\r\n\r\n",
      "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 2\r\nContent-Length: 3\r\n\r\n{}x",
      "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\nContent-Length: 2\r\n\r\n{}",
      "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
      "Transfer-Encoding: chunked\r\n\r\nzz\r\n",
      "\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + std::string(200, '\x5a'),  // TLS
      "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
      std::string(100, '\0') + "\r\n\r\n",
      "GET /\x01 HTTP/1.1\r\nHost: localhost\r\n\r\n",
      "GET /\xff HTTP/1.1\r\nHost: localhost\r\n\r\n",
  };
  for (const std::string& bytes : cases) {
    HttpClient client(http_->address());
    client.Send(bytes);
    const Reply reply = client.ReadReply();
    EXPECT_EQ(reply.code, 400) << testing::PrintToString(bytes);
    EXPECT_EQ(ErrorOf(reply).at("status"), "INVALID_ARGUMENT");
  }
  EXPECT_EQ(Get("/healthz").code, 200);
}

TEST_F(RestTest, TooMuchIsRefused) {
  std::string headers;
  for (int i = 0; i < 10'000; ++i) headers += "X-Header-" + std::to_string(i) + ": value\r\n";
  EXPECT_EQ(ErrorOf(Get("/healthz", headers)).at("code"), 431);
  EXPECT_EQ(Get("/" + std::string(100'000, 'x')).code, 431);
  // Before a byte of it is sent, and whether its length is told or not.
  const std::string post = "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n";
  EXPECT_EQ(ErrorOf(Raw(post + "Content-Length: 1073741824\r\n\r\n")).at("code"), 413);
  HttpClient chunked(http_->address());
  chunked.Send(post + "Transfer-Encoding: chunked\r\n\r\n");
  const std::string megabyte = "100000\r\n" + std::string(1 << 20, ' ') + "\r\n";
  for (int i = 0; i < 17 && chunked.Send(megabyte); ++i) {
  }
  EXPECT_EQ(chunked.ReadReply().code, 413);
  // A body that is as large as may be is read.
  const std::string largest = "{" + std::string((16 << 20) - 2, ' ') + "}";
  EXPECT_EQ(Post("/v1/jobs", largest).code, 400);
  HttpClient careful(http_->address());
  careful.Send(post + "Expect: 100-continue\r\nContent-Length: 2\r\n\r\n");
  EXPECT_EQ(careful.ReadHead().code, 100);
  careful.Send("{}");
  EXPECT_EQ(careful.ReadReply().code, 400);
}

TEST_F(RestTest, WhoIsSlowIsCutOff) {
  http_.reset();
  Start({.header_time = std::chrono::milliseconds(200),
         .body_time = std::chrono::milliseconds(200),
         .idle_time = std::chrono::milliseconds(200)});
  HttpClient silent(http_->address());
  HttpClient loris(http_->address());
  HttpClient body(http_->address());
  body.Send(
      "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 10\r\n\r\n{");
  loris.Send("GET / HTTP/1.1\r\n");
  bool cut_off = false;
  for (int i = 0; i < 1000 && !cut_off; ++i) {  // never silent, and never done
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    cut_off = !loris.Send("X: y\r\n");
  }
  EXPECT_TRUE(cut_off);
  EXPECT_TRUE(silent.Closes());
  EXPECT_EQ(ErrorOf(body.ReadReply()).at("code"), 408);
  EXPECT_TRUE(body.Closes());
  HttpClient head(http_->address());
  head.Send("GET /healthz HTTP/1.1\r\n");
  EXPECT_EQ(ErrorOf(head.ReadReply()).at("code"), 408);
  EXPECT_TRUE(head.Closes());
  HttpClient idle(http_->address());
  EXPECT_EQ(idle.Get("/healthz").code, 200);
  EXPECT_TRUE(idle.Closes());
}

TEST_F(RestTest, ConnectionsAndBodiesAreLimited) {
  http_.reset();
  Start({.max_connections = 2, .max_bodies_bytes = 1 << 20});
  {
    HttpClient large(http_->address());
    const std::string body(2 << 20, ' ');
    large.Send(
        "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        "Content-Length: 8000000\r\n\r\n" +
        body);
    EXPECT_EQ(ErrorOf(large.ReadReply()).at("code"), 429);
    EXPECT_TRUE(large.Closes());
  }
  // The server takes a moment to notice that a client has gone.
  const auto serves = [&](HttpClient& client) { return client.Get("/healthz").code == 200; };
  const auto connect = [&] {
    while (true) {
      auto client = std::make_unique<HttpClient>(http_->address());
      if (serves(*client)) return client;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  };
  for (int round = 0; round < 2; ++round) {
    const auto one = connect();
    const auto two = connect();
    HttpClient three(http_->address());
    EXPECT_EQ(ErrorOf(three.ReadReply()).at("code"), 429);
    EXPECT_TRUE(serves(*one));
    EXPECT_TRUE(serves(*two));
  }
}

TEST_F(RestTest, NoClientTakesAllConnections) {
  http_.reset();
  Start({.max_connections = 5, .max_connections_per_client = 2});
  const auto connect = [&](const std::string& from) { return std::make_unique<HttpClient>(http_->address(), 0, from); };
  const auto serves = [](HttpClient& client) { return client.Get("/healthz").code == 200; };
  auto one = connect("127.0.0.1");
  const auto two = connect("127.0.0.1");
  EXPECT_TRUE(serves(*one) && serves(*two));
  const auto three = connect("127.0.0.1");
  const Reply refused = three->ReadReply();
  EXPECT_EQ(ErrorOf(refused).at("code"), 429);
  EXPECT_THAT(refused.body, HasSubstr("http-max-connections-per-client"));
  EXPECT_EQ(refused.headers.at("retry-after"), "1");
  EXPECT_TRUE(three->Closes());
  const auto other = connect("127.0.0.2");
  EXPECT_TRUE(serves(*other));
  // What it closes it may open again; the server takes a moment to notice.
  one.reset();
  for (auto again = connect("127.0.0.1"); !serves(*again); again = connect("127.0.0.1")) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_TRUE(serves(*two) && serves(*other));
}

TEST_F(RestTest, RequestsInALineAndOldOnes) {
  HttpClient client(http_->address());
  const std::string request = "GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n";
  client.Send(request + request + "GET /readyz HTTP/1.0\r\n\r\n");
  for (int i = 0; i < 3; ++i) EXPECT_EQ(client.ReadReply().body, "ok\n");
  EXPECT_TRUE(client.Closes());
  EXPECT_EQ(Raw("GET http://localhost/healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").body, "ok\n");
}

TEST_F(RestTest, AnAddressInUseIsTold) {
  const auto second = HttpServer::Start({.address = http_->address()}, api_);
  ASSERT_FALSE(second.ok());
  EXPECT_THAT(std::string(second.status().message()), HasSubstr("cannot listen on \"" + http_->address()));
  for (const char* wrong : {"no such host:1", "192.0.2.1:0"}) {
    EXPECT_FALSE(HttpServer::Start({.address = wrong}, api_).ok()) << wrong;
  }
}

// An episode whose caller has gone is given up, and a stop waits for no idle connection.
TEST_F(RestTest, AStopIsQuick) {
  HttpClient idle(http_->address());
  EXPECT_EQ(idle.Get("/healthz").code, 200);
  HttpClient half(http_->address());
  half.Send("GET /healthz HT");
  http_->Shutdown(std::chrono::milliseconds(300));
  EXPECT_TRUE(idle.Closes());
  http_.reset();
  EXPECT_TRUE(half.Closes());
}

}  // namespace
}  // namespace orbitune::server_test
