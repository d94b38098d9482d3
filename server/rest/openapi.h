// The description of the HTTP API (OpenAPI 3.0), made from the routes and the messages' descriptors.
#pragma once

#include <string>

#include "server/rest/routes.h"

namespace orbitune::rest {

std::string OpenApiJson(const RouteTable& routes);

// The route's path as OpenAPI has it: "/v1/jobs/{id}:cancel".
std::string OpenApiPath(const PathTemplate& path);

}  // namespace orbitune::rest
