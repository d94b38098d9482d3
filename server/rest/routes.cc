#include "server/rest/routes.h"

#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "google/api/annotations.pb.h"
#include "server/rest/http.h"
#include "server/rest/text.h"

namespace orbitune::rest {
namespace {

using Segment = PathTemplate::Segment;

void AddSegments(std::string_view text, PathTemplate& out) {
  for (const std::string_view segment : Split(text, '/')) {
    ORBITUNE_CHECK(!segment.empty());
    const Segment::Kind kind = segment == "*"    ? Segment::Kind::kAny
                               : segment == "**" ? Segment::Kind::kRest
                                                 : Segment::Kind::kLiteral;
    out.segments.push_back({kind, std::string(segment)});
  }
}

// "name=jobs/*", or "name" for "name=*".
void AddVariable(std::string_view text, PathTemplate& out) {
  const std::size_t equals = text.find('=');
  const std::size_t begin = out.segments.size();
  AddSegments(equals == text.npos ? "*" : text.substr(equals + 1), out);
  out.variables.push_back({std::string(text.substr(0, equals)), begin, out.segments.size()});
}

// The segments' values, decoded; nothing where the path is another's.
std::optional<std::vector<std::string>> MatchSegments(const PathTemplate& path,
                                                      const std::vector<std::string_view>& parts) {
  std::vector<std::string> values;
  std::size_t at = 0;
  for (const Segment& segment : path.segments) {
    const bool rest = segment.kind == Segment::Kind::kRest;  // only ever the last
    if (!rest && (at == parts.size() || parts[at].empty())) return std::nullopt;
    std::string value;
    const std::size_t end = rest ? parts.size() : at + 1;
    for (std::size_t i = at; i < end; ++i) {
      const auto decoded = PercentDecode(parts[i], false);
      if (!decoded.ok()) return std::nullopt;
      absl::StrAppend(&value, i == at ? "" : "/", *decoded);
    }
    if (segment.kind == Segment::Kind::kLiteral && value != segment.literal) return std::nullopt;
    values.push_back(std::move(value));
    at = end;
  }
  return at == parts.size() ? std::make_optional(std::move(values)) : std::nullopt;
}

// `path` begins with a slash. Where the template has a verb, the path ends with it; else it has none.
std::optional<std::vector<Binding>> Match(const PathTemplate& path, std::string_view text) {
  std::vector<std::string_view> parts = Split(text.substr(1), '/');
  const std::size_t colon = parts.back().rfind(':');
  const std::string_view verb = colon == text.npos ? std::string_view() : parts.back().substr(colon + 1);
  if (verb != path.verb || (colon != text.npos && verb.empty())) return std::nullopt;
  parts.back() = parts.back().substr(0, colon);
  const auto values = MatchSegments(path, parts);
  if (!values) return std::nullopt;
  std::vector<Binding> bindings;
  for (const PathTemplate::Variable& variable : path.variables) {
    Binding binding{variable.field, ""};
    for (std::size_t i = variable.begin; i < variable.end; ++i) {
      absl::StrAppend(&binding.value, i == variable.begin ? "" : "/", (*values)[i]);
    }
    bindings.push_back(std::move(binding));
  }
  return bindings;
}

Route ToRoute(const Method& method, const google::api::HttpRule& rule) {
  Route route{.method = &method,
              .http_method = {},
              .text = {},
              .path = {},
              .body = rule.body(),
              .response_body = rule.response_body()};
  switch (rule.pattern_case()) {
    case google::api::HttpRule::kGet:
      route.http_method = "GET", route.text = rule.get();
      break;
    case google::api::HttpRule::kPost:
      route.http_method = "POST", route.text = rule.post();
      break;
    case google::api::HttpRule::kPut:
      route.http_method = "PUT", route.text = rule.put();
      break;
    case google::api::HttpRule::kPatch:
      route.http_method = "PATCH", route.text = rule.patch();
      break;
    case google::api::HttpRule::kDelete:
      route.http_method = "DELETE", route.text = rule.delete_();
      break;
    case google::api::HttpRule::kCustom:
      route.http_method = rule.custom().kind(), route.text = rule.custom().path();
      break;
    case google::api::HttpRule::PATTERN_NOT_SET:
      ORBITUNE_CHECK(false);
  }
  route.path = ParsePathTemplate(route.text);
  return route;
}

}  // namespace

PathTemplate ParsePathTemplate(std::string_view text) {
  PathTemplate path;
  ORBITUNE_CHECK(text.starts_with('/'));
  // A verb stands behind the last brace and slash.
  const std::size_t colon = text.rfind(':');
  if (colon != text.npos && text.find_first_of("/}", colon) == text.npos) {
    path.verb = text.substr(colon + 1);
    text = text.substr(0, colon);
  }
  while (!text.empty()) {
    ORBITUNE_CHECK(text.starts_with('/'));
    text.remove_prefix(1);
    if (text.starts_with('{')) {
      const std::size_t end = text.find('}');
      ORBITUNE_CHECK(end != text.npos);
      AddVariable(text.substr(1, end - 1), path);
      text.remove_prefix(end + 1);
    } else {
      const std::size_t end = std::min(text.find('/'), text.size());
      AddSegments(text.substr(0, end), path);
      text.remove_prefix(end);
    }
  }
  return path;
}

RouteTable::RouteTable(const MethodTable& methods) {
  for (const auto& [name, method] : methods.all()) {
    const google::protobuf::MethodOptions& options = method.descriptor->options();
    if (!options.HasExtension(google::api::http)) continue;
    const google::api::HttpRule& rule = options.GetExtension(google::api::http);
    routes_.push_back(ToRoute(method, rule));
    for (const google::api::HttpRule& more : rule.additional_bindings()) routes_.push_back(ToRoute(method, more));
  }
}

RouteTable::Match RouteTable::Find(std::string_view http_method, std::string_view path) const {
  Match found;
  const std::string_view wanted = http_method == "HEAD" ? "GET" : http_method;
  for (const Route& route : routes_) {
    auto bindings = rest::Match(route.path, path);
    if (!bindings) continue;
    found.allowed.push_back(route.http_method);
    if (route.http_method == "GET") found.allowed.emplace_back("HEAD");
    if (route.http_method != wanted || found.route != nullptr) continue;
    found.route = &route;
    found.bindings = *std::move(bindings);
  }
  return found;
}

}  // namespace orbitune::rest
