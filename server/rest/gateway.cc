#include "server/rest/gateway.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "core/base/status.h"
#include "server/api/json.h"
#include "server/rest/compress.h"
#include "server/rest/credentials.h"
#include "server/rest/error.h"
#include "server/rest/openapi.h"
#include "server/rest/session.h"
#include "server/rest/text.h"
#include "server/rest/transcode.h"

namespace orbitune::rest {
namespace {

constexpr char kJson[] = "application/json";
constexpr std::string_view kSession = "/v1/session";

HttpReply Ok(std::string_view type, std::string body) {
  return {.code = 200, .headers = {{"Content-Type", std::string(type)}}, .body = std::move(body)};
}

HttpReply MethodNotAllowed(const std::vector<std::string>& allowed) {
  const std::string list = absl::StrJoin(allowed, ", ");
  HttpReply reply =
      ErrorReply(absl::UnimplementedError(absl::StrCat("not a method of this path, which has ", list)), 405);
  reply.headers.emplace_back("Allow", list);
  return reply;
}

// A body of so many bytes is read as JSON where it arrives; a larger one on another thread.
constexpr std::size_t kReadAtOnce = 4096;

// Of a body that comes with no token: to log in, or where nobody reads it.
constexpr std::size_t kLargestOpenBody = 4096;

// "https://example.org:8443" without its scheme.
std::string_view HostOf(std::string_view origin) {
  const std::size_t scheme = origin.find("://");
  return scheme == origin.npos ? std::string_view() : origin.substr(scheme + 3);
}

std::string_view WithoutPort(std::string_view host) {
  const std::size_t colon = host.rfind(':');
  return colon == host.npos || host.ends_with(']') ? host : host.substr(0, colon);
}

bool IsLocalhostOrAddress(std::string_view host) {
  host = WithoutPort(host);
  if (host.starts_with('[') || EqualNoCase(host, "localhost")) return true;
  return !host.empty() && host.find_first_not_of("0123456789.") == host.npos;
}

bool IsJson(std::string_view content_type) {
  return EqualNoCase(Trim(content_type.substr(0, content_type.find(';'))), kJson);
}

HttpReply NotJson(const HttpRequest& request) {
  return ErrorReply(absl::InvalidArgumentError(absl::StrCat("Content-Type: must be application/json, got ",
                                                            FormatReceived(request.header("Content-Type")))),
                    415);
}

HttpReply Encoded(const HttpRequest& request) {
  return ErrorReply(absl::InvalidArgumentError(absl::StrCat("Content-Encoding: a request is sent as it is, got ",
                                                            FormatReceived(request.header("Content-Encoding")))),
                    415);
}

bool Reads(std::string_view http_method) { return http_method == "GET" || http_method == "HEAD"; }

}  // namespace

// A request on its way.
struct Gateway::Exchange {
  HttpRequest request;
  Target target;
  CallContext context;
  std::function<void(Reply)> done;
  std::unique_ptr<google::protobuf::Message> in;
  std::unique_ptr<google::protobuf::Message> out;
};

Gateway::Gateway(Api& api, GatewayOptions options)
    : api_(api),
      options_(std::move(options)),
      routes_(api.methods()),
      files_(options_.web_dir),
      openapi_(OpenApiJson(routes_)) {}

void Gateway::Handle(HttpRequest request, Cancelled cancelled, std::function<void(Reply)> done) {
  auto exchange =
      std::make_shared<Exchange>(Exchange{std::move(request), {}, {{}, std::move(cancelled)}, std::move(done), {}, {}});
  if (absl::Status status = CheckOrigin(exchange->request); !status.ok()) return Send(*exchange, ErrorReply(status));
  auto target = ParseTarget(exchange->request.target);
  if (!target.ok()) return Send(*exchange, ErrorReply(target.status()));
  exchange->target = *std::move(target);
  const std::string& path = exchange->target.path;
  const std::string& method = exchange->request.method;
  if (path == kSession && (method == "POST" || method == "DELETE")) return HandleSession(exchange);
  const bool is_fixed = path == "/healthz" || path == "/readyz" || path == "/openapi.json" || path == "/metrics";
  RouteTable::Match match = routes_.Find(method, path);
  const bool is_api = is_fixed || !match.allowed.empty() || path.starts_with("/v1/");
  if (!is_api || is_fixed) match.allowed = {"GET", "HEAD"};
  if (path == kSession) match.allowed = {"POST", "DELETE"};
  if (match.route != nullptr) return HandleRoute(match, exchange);
  if (match.allowed.empty()) {
    return Send(*exchange, ErrorReply(absl::NotFoundError("no such path; /openapi.json lists what there is")));
  }
  if (method == "OPTIONS") return Send(*exchange, Preflight(exchange->request, match.allowed));
  if (!Reads(method) || path == kSession) return Send(*exchange, MethodNotAllowed(match.allowed));
  if (path == "/metrics" && options_.metrics) return HandleMetrics(exchange);
  if (is_fixed) return Send(*exchange, Fixed(exchange->request, exchange->target));
  if (is_api) return Send(*exchange, MethodNotAllowed(match.allowed));
  HandleFile(exchange);
}

HttpReply Gateway::Refuse(const absl::Status& status, int http_code) const { return ErrorReply(status, http_code); }

Gateway::Reply Gateway::Fixed(const HttpRequest&, const Target& target) const {
  if (target.path == "/openapi.json") return Ok(kJson, openapi_);
  if (target.path == "/metrics") return ErrorReply(absl::NotFoundError("this server shows no metrics"));
  const std::lock_guard lock(state_mutex_);
  if (target.path == "/healthz" || state_.ok()) return Ok("text/plain; charset=utf-8", "ok\n");
  return ErrorReply(state_);
}

absl::Status Gateway::CheckOrigin(const HttpRequest& request) const {
  const std::string_view host = request.header("Host");
  const auto is_hosts = [host](const std::string& origin) { return EqualNoCase(HostOf(origin), host); };
  // Every browser says which host it means.
  if (options_.local_hosts_only && !host.empty() && !IsLocalhostOrAddress(host) &&
      std::ranges::none_of(options_.cors_origins, is_hosts)) {
    return absl::PermissionDeniedError(
        absl::StrCat("this server is not ", FormatReceived(host), ": it is called localhost, or by its address"));
  }
  const std::string_view origin = request.header("Origin");
  if (ByCookie(request) && !Reads(request.method) && !EqualNoCase(HostOf(origin), host)) {
    return absl::PermissionDeniedError("with the session's cookie only this server's own pages may change something");
  }
  if (origin.empty() || Reads(request.method) || request.method == "OPTIONS") return absl::OkStatus();
  if (EqualNoCase(HostOf(origin), host) || IsAllowedOrigin(origin)) return absl::OkStatus();
  return absl::PermissionDeniedError(absl::StrCat("a page of ", FormatReceived(origin),
                                                  " may change nothing here: the server does not name it in "
                                                  "--http-cors-origin"));
}

bool Gateway::IsAllowedOrigin(std::string_view origin) const {
  return std::ranges::any_of(options_.cors_origins, [origin](const std::string& allowed) {
    return allowed == "*" || EqualNoCase(allowed, origin);
  });
}

std::variant<Caller, HttpReply> Gateway::Admit(const Method& method, const HttpRequest& request, bool has_body) const {
  auto caller = api_.Authenticate(CredentialsOf(request), method.descriptor->full_name());
  absl::Status status = caller.status();
  if (status.ok()) status = api_.CheckRole(method, *caller);
  if (!status.ok()) return AccessRefusal(status, request);
  if (has_body && !IsJson(request.header("Content-Type"))) return NotJson(request);
  if (!request.header("Content-Encoding").empty()) return Encoded(request);
  return *std::move(caller);
}

std::variant<std::size_t, HttpReply> Gateway::AdmitBody(const HttpRequest& head) const {
  const auto refuse = [&](HttpReply reply) {
    AddHeaders(head, reply.headers);
    return reply;
  };
  if (absl::Status status = CheckOrigin(head); !status.ok()) return refuse(ErrorReply(status));
  const auto target = ParseTarget(head.target);
  if (!target.ok()) return refuse(ErrorReply(target.status()));
  const RouteTable::Match match = routes_.Find(head.method, target->path);
  if (match.route == nullptr) return kLargestOpenBody;
  auto admitted = Admit(*match.route->method, head, true);
  if (auto* refusal = std::get_if<HttpReply>(&admitted)) return refuse(std::move(*refusal));
  return options_.max_body_bytes;
}

void Gateway::HandleSession(const std::shared_ptr<Exchange>& exchange) {
  const HttpRequest& request = exchange->request;
  if (request.method == "POST" && !IsJson(request.header("Content-Type"))) return Send(*exchange, NotJson(request));
  Post(Work::kWrite, exchange, [self = shared_from_this(), exchange] {
    const HttpRequest& asked = exchange->request;
    self->Send(*exchange,
               asked.method == "POST" ? LogIn(self->api_.access(), asked) : LogOut(self->api_.access(), asked));
  });
}

void Gateway::Post(Work work, const std::shared_ptr<Exchange>& exchange, std::function<void()> task) {
  const absl::Status posted = api_.executors().For(work).TryPost(exchange->request.peer, std::move(task));
  if (!posted.ok()) Send(*exchange, ErrorReply(posted));
}

void Gateway::HandleRoute(const RouteTable::Match& match, const std::shared_ptr<Exchange>& exchange) {
  const HttpRequest& request = exchange->request;
  auto admitted = Admit(*match.route->method, request, !request.body.empty());
  if (auto* refusal = std::get_if<HttpReply>(&admitted)) return Send(*exchange, std::move(*refusal));
  exchange->context.caller = std::get<Caller>(std::move(admitted));
  if (match.route->method->open != nullptr) return Send(*exchange, OpenStream(match, *exchange));
  exchange->context.transport = "http";
  if (request.body.size() <= kReadAtOnce) return CallMethod(match, exchange);
  Post(Work::kWrite, exchange, [self = shared_from_this(), match, exchange] { self->CallMethod(match, exchange); });
}

void Gateway::HandleFile(const std::shared_ptr<Exchange>& exchange) {
  Post(Work::kRead, exchange, [self = shared_from_this(), exchange] {
    self->Send(*exchange, self->files_.Get(exchange->request, exchange->target.path));
  });
}

// As Prometheus reads it. With tokens, it needs one.
void Gateway::HandleMetrics(const std::shared_ptr<Exchange>& exchange) {
  const auto caller = api_.Authenticate(CredentialsOf(exchange->request), "metrics");
  if (!caller.ok()) return Send(*exchange, AccessRefusal(caller.status(), exchange->request));
  Post(Work::kRead, exchange, [self = shared_from_this(), exchange] {
    HttpReply reply = Ok("text/plain; version=0.0.4; charset=utf-8", self->options_.metrics());
    reply.headers.emplace_back("Cache-Control", "no-store");
    if (Accepts(exchange->request.header("Accept-Encoding"), "gzip")) Compress(reply);
    self->Send(*exchange, std::move(reply));
  });
}

void Gateway::CallMethod(const RouteTable::Match& match, const std::shared_ptr<Exchange>& exchange) {
  const Method& method = *match.route->method;
  exchange->in.reset(method.request->New());
  exchange->out.reset(method.response->New());
  const absl::Status status =
      ReadRequest(*match.route, match.bindings, exchange->target.query, exchange->request.body, exchange->in.get());
  if (!status.ok()) return Send(*exchange, ErrorReply(status));
  exchange->request.body = std::string();
  api_.Call(method, exchange->context, *exchange->in, exchange->out.get(),
            [self = shared_from_this(), exchange](const absl::Status& answered) {
              self->Send(*exchange, answered.ok() ? Answer(*exchange) : ErrorReply(answered));
            });
}

HttpReply Gateway::Answer(const Exchange& exchange) {
  HttpReply reply = Ok(kJson, ToJson(*exchange.out) + "\n");
  reply.headers.emplace_back("Cache-Control", "no-store");
  if (Accepts(exchange.request.header("Accept-Encoding"), "gzip")) Compress(reply);
  return reply;
}

Gateway::Reply Gateway::OpenStream(const RouteTable::Match& match, Exchange& exchange) const {
  StreamReply reply{.feed = nullptr,
                    .sse = Accepts(exchange.request.header("Accept"), "text/event-stream"),
                    .resumed = false,
                    .headers = {}};
  std::vector<Query> query = exchange.target.query;
  // A browser that reconnects says where it was; its address still says where it began.
  if (const std::string_view last = exchange.request.header("Last-Event-ID"); !last.empty()) {
    reply.resumed = true;
    std::erase_if(query, [](const Query& q) { return q.name == "resume_after_seq" || q.name == "resumeAfterSeq"; });
    query.push_back({"resume_after_seq", std::string(last)});
  }
  const Method& method = *match.route->method;
  const std::unique_ptr<google::protobuf::Message> request(method.request->New());
  const absl::Status status = ReadRequest(*match.route, match.bindings, query, exchange.request.body, request.get());
  if (!status.ok()) return ErrorReply(status);
  reply.headers = {{"Content-Type", reply.sse ? "text/event-stream" : "application/x-ndjson"},
                   {"Cache-Control", "no-store"},
                   {"X-Accel-Buffering", "no"}};
  exchange.context.transport = reply.sse ? "sse" : "ndjson";
  reply.feed = api_.Open(method, exchange.context, *request);
  return reply;
}

HttpReply Gateway::Preflight(const HttpRequest& request, const std::vector<std::string>& allowed) const {
  HttpReply reply{.code = 204, .headers = {{"Allow", absl::StrJoin(allowed, ", ")}}, .body = {}};
  if (IsAllowedOrigin(request.header("Origin"))) {
    reply.headers.emplace_back("Access-Control-Allow-Methods", absl::StrJoin(allowed, ", "));
    reply.headers.emplace_back("Access-Control-Allow-Headers", "Authorization, Content-Type, Last-Event-ID");
    reply.headers.emplace_back("Access-Control-Max-Age", "600");
  }
  return reply;
}

void Gateway::AddHeaders(const HttpRequest& request, Headers& headers) const {
  headers.emplace_back("X-Content-Type-Options", "nosniff");
  if (const std::string_view origin = request.header("Origin"); !origin.empty() && IsAllowedOrigin(origin)) {
    headers.emplace_back("Access-Control-Allow-Origin", origin);
    headers.emplace_back("Access-Control-Expose-Headers", "Retry-After, X-Request-Id");
  }
  if (!options_.cors_origins.empty()) headers.emplace_back("Vary", "Origin");
}

void Gateway::Send(const Exchange& exchange, Reply reply) const {
  auto& headers = std::visit(
      [](auto& r) -> auto& { return r.headers; }, reply);
  AddHeaders(exchange.request, headers);
  const std::string& request_id = exchange.context.caller.request_id;
  if (!request_id.empty()) headers.emplace_back("X-Request-Id", request_id);
  exchange.done(std::move(reply));
}

}  // namespace orbitune::rest
