// HTTP into request messages: the path's variables, the query's parameters, the body.
#pragma once

#include <string>
#include <vector>

#include "server/rest/http.h"
#include "server/rest/routes.h"

namespace orbitune::rest {

// Fills `message`, of the route's request type. INVALID_ARGUMENT with field violations for a parameter that names no
// field or has a value that is none of its type, and for a body that is no such JSON.
absl::Status ReadRequest(const Route& route, const std::vector<Binding>& bindings, const std::vector<Query>& query,
                         const std::string& body, google::protobuf::Message* message);

// Sets the field at `path` ("job.hyperparameters.seed", names in either form) from text; appends where it is repeated.
absl::Status SetField(google::protobuf::Message* message, const std::string& path, const std::string& value);

}  // namespace orbitune::rest
