#include "server/rest/gateway.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "core/base/status.h"
#include "server/api/json.h"
#include "server/rest/compress.h"
#include "server/rest/error.h"
#include "server/rest/openapi.h"
#include "server/rest/text.h"
#include "server/rest/transcode.h"

namespace orbitune::rest {
namespace {

constexpr char kJson[] = "application/json";

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

HttpReply TooManyWaiting() { return ErrorReply(absl::ResourceExhaustedError("too many requests are waiting")); }

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

bool Reads(std::string_view http_method) { return http_method == "GET" || http_method == "HEAD"; }

}  // namespace

// A request on its way.
struct Gateway::Exchange {
  HttpRequest request;
  Target target;
  Cancelled cancelled;
  std::function<void(Reply)> done;
};

Gateway::Gateway(Api& api, GatewayOptions options)
    : api_(api),
      options_(std::move(options)),
      routes_(api.methods()),
      files_(options_.web_dir),
      openapi_(OpenApiJson(routes_)) {}

void Gateway::Handle(HttpRequest request, Cancelled cancelled, std::function<void(Reply)> done) {
  auto exchange = std::make_shared<Exchange>(Exchange{std::move(request), {}, std::move(cancelled), std::move(done)});
  if (absl::Status status = CheckOrigin(exchange->request); !status.ok()) return Send(*exchange, ErrorReply(status));
  auto target = ParseTarget(exchange->request.target);
  if (!target.ok()) return Send(*exchange, ErrorReply(target.status()));
  exchange->target = *std::move(target);
  const std::string& path = exchange->target.path;
  const std::string& method = exchange->request.method;
  const bool is_fixed = path == "/healthz" || path == "/readyz" || path == "/openapi.json";
  RouteTable::Match match = routes_.Find(method, path);
  const bool is_api = is_fixed || !match.allowed.empty() || path.starts_with("/v1/");
  if (!is_api || is_fixed) match.allowed = {"GET", "HEAD"};
  if (match.route != nullptr) return HandleRoute(match, exchange);
  if (match.allowed.empty()) {
    return Send(*exchange, ErrorReply(absl::NotFoundError("no such path; /openapi.json lists what there is")));
  }
  if (method == "OPTIONS") return Send(*exchange, Preflight(exchange->request, match.allowed));
  if (!Reads(method)) return Send(*exchange, MethodNotAllowed(match.allowed));
  if (is_fixed) return Send(*exchange, Fixed(exchange->request, exchange->target));
  if (is_api) return Send(*exchange, MethodNotAllowed(match.allowed));
  HandleFile(exchange);
}

HttpReply Gateway::Refuse(const absl::Status& status, int http_code) const { return ErrorReply(status, http_code); }

Gateway::Reply Gateway::Fixed(const HttpRequest&, const Target& target) const {
  if (target.path == "/openapi.json") return Ok(kJson, openapi_);
  if (target.path == "/healthz" || serving_) return Ok("text/plain; charset=utf-8", "ok\n");
  return ErrorReply(absl::UnavailableError("the server is going down, or its disk fails"));
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

void Gateway::HandleRoute(const RouteTable::Match& match, const std::shared_ptr<Exchange>& exchange) {
  const HttpRequest& request = exchange->request;
  if (!request.body.empty() && !IsJson(request.header("Content-Type"))) {
    return Send(*exchange,
                ErrorReply(absl::InvalidArgumentError(absl::StrCat("Content-Type: must be application/json, got ",
                                                                   FormatReceived(request.header("Content-Type")))),
                           415));
  }
  if (const std::string_view coding = request.header("Content-Encoding"); !coding.empty()) {
    return Send(*exchange,
                ErrorReply(absl::InvalidArgumentError(absl::StrCat("Content-Encoding: a request is sent as it is, got ",
                                                                   FormatReceived(coding))),
                           415));
  }
  if (match.route->method->open != nullptr) return Send(*exchange, OpenStream(match, *exchange));
  const bool posted =
      api_.executors().For(match.route->method->work).TryPost([self = shared_from_this(), match, exchange] {
        self->Send(*exchange, self->Answer(match, *exchange));
      });
  if (!posted) Send(*exchange, TooManyWaiting());
}

void Gateway::HandleFile(const std::shared_ptr<Exchange>& exchange) {
  const bool posted = api_.executors().For(Work::kRead).TryPost([self = shared_from_this(), exchange] {
    self->Send(*exchange, self->files_.Get(exchange->request, exchange->target.path));
  });
  if (!posted) Send(*exchange, TooManyWaiting());
}

HttpReply Gateway::Answer(const RouteTable::Match& match, const Exchange& exchange) const {
  const Method& method = *match.route->method;
  const std::unique_ptr<google::protobuf::Message> request(method.request->New());
  absl::Status status =
      ReadRequest(*match.route, match.bindings, exchange.target.query, exchange.request.body, request.get());
  if (!status.ok()) return ErrorReply(status);
  const std::unique_ptr<google::protobuf::Message> response(method.response->New());
  status = method.answer(*request, response.get(), exchange.cancelled);
  if (!status.ok()) return ErrorReply(status);
  HttpReply reply = Ok(kJson, ToJson(*response) + "\n");
  reply.headers.emplace_back("Cache-Control", "no-store");
  if (Accepts(exchange.request.header("Accept-Encoding"), "gzip")) Compress(reply);
  return reply;
}

Gateway::Reply Gateway::OpenStream(const RouteTable::Match& match, const Exchange& exchange) const {
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
  reply.feed = method.open(*request);
  return reply;
}

HttpReply Gateway::Preflight(const HttpRequest& request, const std::vector<std::string>& allowed) const {
  HttpReply reply{.code = 204, .headers = {{"Allow", absl::StrJoin(allowed, ", ")}}, .body = {}};
  if (IsAllowedOrigin(request.header("Origin"))) {
    reply.headers.emplace_back("Access-Control-Allow-Methods", absl::StrJoin(allowed, ", "));
    reply.headers.emplace_back("Access-Control-Allow-Headers", "Content-Type, Last-Event-ID");
    reply.headers.emplace_back("Access-Control-Max-Age", "600");
  }
  return reply;
}

void Gateway::Send(const Exchange& exchange, Reply reply) const {
  auto& headers = std::visit(
      [](auto& r) -> auto& { return r.headers; }, reply);
  headers.emplace_back("X-Content-Type-Options", "nosniff");
  if (const std::string_view origin = exchange.request.header("Origin"); !origin.empty() && IsAllowedOrigin(origin)) {
    headers.emplace_back("Access-Control-Allow-Origin", origin);
    headers.emplace_back("Access-Control-Expose-Headers", "Retry-After");
  }
  if (!options_.cors_origins.empty()) headers.emplace_back("Vary", "Origin");
  exchange.done(std::move(reply));
}

void AppendSse(const StreamMessage& message, std::string& out) {
  absl::StrAppend(&out, "id: ", message.about().resume_after_seq, "\nevent: ", ToAbsl(message.about().kind),
                  "\ndata: ", message.json(), "\n\n");
}

}  // namespace orbitune::rest
