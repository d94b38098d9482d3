// The routes, as the google.api.http options of the methods say: the proto is the one route table.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "server/api/methods.h"

namespace orbitune::rest {

// "/v1/{name=jobs/*}:cancel", taken apart.
struct PathTemplate {
  struct Segment {
    enum class Kind { kLiteral, kAny, kRest } kind;  // "jobs", "*", "**"
    std::string literal;
  };
  // The field whose value is segments [begin, end), joined by "/".
  struct Variable {
    std::string field;
    std::size_t begin;
    std::size_t end;
  };
  std::vector<Segment> segments;
  std::vector<Variable> variables;
  std::string verb;  // "cancel"; empty: none
};

// A bug in the proto ends the process: the options are constant.
PathTemplate ParsePathTemplate(std::string_view text);

struct Route {
  const Method* method;
  std::string http_method;  // "GET"
  std::string text;         // the template as written
  PathTemplate path;
  std::string body;           // "*", a field, or empty: there is none
  std::string response_body;  // a field, or empty: all of the answer
};

struct Binding {
  std::string field;  // "name"
  std::string value;  // "jobs/abc"
};

class RouteTable {
 public:
  // methods: outlives this.
  explicit RouteTable(const MethodTable& methods);

  struct Match {
    const Route* route = nullptr;  // nullptr: none has this path and method
    std::vector<Binding> bindings;
    std::vector<std::string> allowed;  // the HTTP methods that this path has; none: there is no such path
  };
  // path: percent-encoded. HEAD finds what GET would.
  Match Find(std::string_view http_method, std::string_view path) const;

  const std::vector<Route>& all() const { return routes_; }

 private:
  std::vector<Route> routes_;
};

}  // namespace orbitune::rest
