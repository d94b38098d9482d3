#include "server/rest/openapi.h"

#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_cat.h"
#include "orbitune/v1/audit.pb.h"
#include "server/rest/comments.h"

namespace orbitune::rest {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::EnumDescriptor;
using google::protobuf::FieldDescriptor;
using Json = nlohmann::ordered_json;

// Adds what is said of it, where anything is.
Json Described(Json json, const std::string& text) {
  if (text.empty()) return json;
  if (!json.contains("$ref")) {
    const std::string more = json.value("description", "");
    json["description"] = more.empty() ? text : absl::StrCat(text, " ", more);
    return json;
  }
  return {{"allOf", Json::array({std::move(json)})}, {"description", text}};  // nothing may stand beside a $ref
}

Json Reference(const std::string& name) { return {{"$ref", "#/components/schemas/" + name}}; }

// Schemas of the messages that are used, by name.
class Schemas {
 public:
  explicit Schemas(const Comments& comments) : comments_(comments) { schemas_["Error"] = ErrorSchema(); }

  const Comments& comments() const { return comments_; }

  Json Of(const Descriptor* type) {
    if (type->full_name() == "google.protobuf.Timestamp") return {{"type", "string"}, {"format", "date-time"}};
    if (type->full_name() == "google.protobuf.Duration") return {{"type", "string"}};
    if (!schemas_.contains(type->name())) {
      schemas_[type->name()] = nullptr;  // it may contain itself
      schemas_[type->name()] = Object(type);
    }
    return Reference(type->name());
  }

  Json Of(const FieldDescriptor* field) { return Described(Bare(field), comments_.Of(field)); }

  Json Take() { return Json(schemas_); }

 private:
  Json Bare(const FieldDescriptor* field) {
    if (field->is_map()) {
      return {{"type", "object"}, {"additionalProperties", Single(field->message_type()->FindFieldByNumber(2))}};
    }
    if (field->is_repeated()) return {{"type", "array"}, {"items", Single(field)}};
    return Single(field);
  }

  static Json ErrorSchema() {
    Json error = {{"type", "object"},
                  {"properties",
                   {{"code", {{"type", "integer"}, {"description", "the HTTP code"}}},
                    {"status", {{"type", "string"}, {"description", "the canonical code, INVALID_ARGUMENT say"}}},
                    {"message", {{"type", "string"}}},
                    {"details",
                     {{"type", "array"},
                      {"items", {{"type", "object"}, {"additionalProperties", true}}},
                      {"description", "google.rpc.BadRequest, ErrorInfo, RetryInfo, told apart by @type"}}}}}};
    return {{"type", "object"}, {"properties", {{"error", std::move(error)}}}};
  }

  Json Object(const Descriptor* type) {
    Json properties = Json::object();
    for (int i = 0; i < type->field_count(); ++i) properties[type->field(i)->name()] = Of(type->field(i));
    return Described({{"type", "object"}, {"properties", std::move(properties)}, {"additionalProperties", false}},
                     comments_.Of(type));
  }

  Json Enum(const EnumDescriptor* type) const {
    Json names = Json::array();
    std::string text = comments_.Of(type);
    for (int i = 0; i < type->value_count(); ++i) {
      const std::string& name = type->value(i)->name();
      const std::string comment = comments_.Of(type->value(i));
      names.push_back(name);
      if (!comment.empty()) absl::StrAppend(&text, text.empty() ? "" : " ", name, ": ", comment, ".");
    }
    return Described({{"type", "string"}, {"enum", std::move(names)}}, text);
  }

  Json Single(const FieldDescriptor* field) {
    switch (field->cpp_type()) {
      case FieldDescriptor::CPPTYPE_BOOL:
        return {{"type", "boolean"}};
      case FieldDescriptor::CPPTYPE_INT32:
      case FieldDescriptor::CPPTYPE_UINT32:
        return {{"type", "integer"}, {"format", "int32"}};
      case FieldDescriptor::CPPTYPE_INT64:
        return {{"type", "string"}, {"format", "int64"}};
      case FieldDescriptor::CPPTYPE_UINT64:
        return {{"type", "string"}, {"format", "uint64"}};
      case FieldDescriptor::CPPTYPE_DOUBLE:
      case FieldDescriptor::CPPTYPE_FLOAT:
        return {{"type", "number"}, {"format", "double"}};
      case FieldDescriptor::CPPTYPE_ENUM:
        return Enum(field->enum_type());
      case FieldDescriptor::CPPTYPE_STRING:
        return {{"type", "string"}};
      case FieldDescriptor::CPPTYPE_MESSAGE:
        return Of(field->message_type());
    }
    return {};
  }

  const Comments& comments_;
  std::map<std::string, Json> schemas_;
};

bool IsMessage(const FieldDescriptor* field) {
  return field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE &&
         field->message_type()->file()->package() != "google.protobuf";
}

// One parameter for each field that a query can set, "a.b" for one inside of another.
void AddQueryParameters(const Descriptor* type, const std::string& prefix, const std::set<std::string>& taken,
                        Schemas& schemas, Json& parameters) {
  for (int i = 0; i < type->field_count(); ++i) {
    const FieldDescriptor* field = type->field(i);
    const std::string name = prefix + field->name();
    if (taken.contains(name) || field->is_map()) continue;
    if (!IsMessage(field)) {
      parameters.push_back(
          Described({{"name", name}, {"in", "query"}, {"schema", schemas.Of(field)}}, schemas.comments().Of(field)));
    } else if (!field->is_repeated() && field->message_type() != type) {
      AddQueryParameters(field->message_type(), name + ".", taken, schemas, parameters);
    }
  }
}

Json Parameters(const Route& route, Schemas& schemas) {
  Json parameters = Json::array();
  const std::string path = OpenApiPath(route.path);
  for (std::size_t begin = path.find('{'); begin != path.npos; begin = path.find('{', begin + 1)) {
    const std::string name = path.substr(begin + 1, path.find('}', begin) - begin - 1);
    parameters.push_back({{"name", name}, {"in", "path"}, {"required", true}, {"schema", {{"type", "string"}}}});
  }
  if (route.body == "*") return parameters;
  std::set<std::string> taken = {route.body};
  for (const PathTemplate::Variable& variable : route.path.variables) taken.insert(variable.field);
  AddQueryParameters(route.method->descriptor->input_type(), "", taken, schemas, parameters);
  return parameters;
}

Json Content(std::initializer_list<const char*> types, const Json& schema) {
  Json content = Json::object();
  for (const char* type : types) content[type] = {{"schema", schema}};
  return {{"content", std::move(content)}};
}

Json Operation(const Route& route, Schemas& schemas) {
  const google::protobuf::MethodDescriptor& method = *route.method->descriptor;
  Json operation = {{"operationId", absl::StrCat(method.service()->name(), "_", method.name())},
                    {"tags", {method.service()->name()}},
                    {"x-orbitune-role", std::string(NameOf(route.method->access.role))},
                    {"parameters", Parameters(route, schemas)}};
  operation = Described(std::move(operation), schemas.comments().Of(&method));
  if (!route.body.empty()) {
    const Descriptor* request = method.input_type();
    operation["requestBody"] =
        Content({"application/json"},
                route.body == "*" ? schemas.Of(request) : schemas.Of(request->FindFieldByName(route.body)));
  }
  const Json answer = schemas.Of(method.output_type());
  Json success = method.server_streaming() ? Content({"text/event-stream", "application/x-ndjson"}, answer)
                                           : Content({"application/json"}, answer);
  success["description"] = method.server_streaming() ? "the events, one a message" : "the answer";
  Json error = Content({"application/json"}, Reference("Error"));
  error["description"] = "an error";
  operation["responses"] = {{"200", std::move(success)}, {"default", std::move(error)}};
  return operation;
}

// How a browser logs in and out: HTTP only, and so no method.
Json SessionPath(Schemas& schemas) {
  Json error = Content({"application/json"}, Reference("Error"));
  error["description"] = "an error";
  const auto operation = [&error](const char* id, const char* code, Json success) {
    return Json{{"operationId", id},
                {"tags", {"AccessService"}},
                {"responses", {{code, std::move(success)}, {"default", error}}}};
  };
  Json caller = Content({"application/json"}, schemas.Of(v1::Caller::descriptor()));
  caller["description"] = "who that is; the cookie comes with it";
  Json log_in = operation("LogIn", "200", std::move(caller));
  log_in["requestBody"] = Content({"application/json"}, schemas.Of(v1::CreateSessionRequest::descriptor()));
  log_in["security"] = Json::array();
  return {{"post", std::move(log_in)}, {"delete", operation("LogOut", "204", {{"description", "logged out"}})}};
}

// None where the server has no tokens.
Json SecuritySchemes() {
  return {{"token", {{"type", "http"}, {"scheme", "bearer"}}},
          {"session", {{"type", "apiKey"}, {"in", "cookie"}, {"name", "orbitune_session"}}}};
}

std::string Lowercase(std::string text) {
  for (char& c : text) c = static_cast<char>(c | 0x20);
  return text;
}

}  // namespace

std::string OpenApiPath(const PathTemplate& path) {
  std::string text;
  int wildcards = 0;
  for (const PathTemplate::Segment& segment : path.segments) {
    if (segment.kind == PathTemplate::Segment::Kind::kLiteral) {
      absl::StrAppend(&text, "/", segment.literal);
    } else {
      absl::StrAppend(&text, "/{id", ++wildcards == 1 ? "" : absl::StrCat("_", wildcards), "}");
    }
  }
  return path.verb.empty() ? text : absl::StrCat(text, ":", path.verb);
}

std::string OpenApiJson(const RouteTable& routes) {
  const Comments comments;
  Schemas schemas(comments);
  Json paths = Json::object();
  std::map<std::string, Json> tags;  // a service each
  for (const Route& route : routes.all()) {
    const auto* service = route.method->descriptor->service();
    tags[service->name()] = Described({{"name", service->name()}}, comments.OfFile(service->file()));
    paths[OpenApiPath(route.path)][Lowercase(route.http_method)] = Operation(route, schemas);
  }
  paths["/v1/session"] = SessionPath(schemas);
  Json document = {{"openapi", "3.0.3"},
                   {"info",
                    {{"title", "Orbitune"},
                     {"version", "v1"},
                     {"description",
                      "Tunes the gains of an orbital tracking controller. Names carry units; 64-bit integers are "
                      "strings. Docs: docs/api.md; the same over gRPC."}}},
                   {"tags", Json::array()},
                   {"security", {Json::object(), {{"token", Json::array()}}, {{"session", Json::array()}}}},
                   {"paths", std::move(paths)},
                   {"components", {{"schemas", schemas.Take()}, {"securitySchemes", SecuritySchemes()}}}};
  for (auto& [name, tag] : tags) document["tags"].push_back(std::move(tag));
  return document.dump(2) + "\n";
}

}  // namespace orbitune::rest
