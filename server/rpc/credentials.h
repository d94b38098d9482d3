// How a gRPC call says who sends it, and under what certificates the server listens.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>

#include "server/access/access.h"
#include "server/access/tls.h"

namespace orbitune {

// From the metadata "authorization: Bearer TOKEN" and "x-request-id". Views into the context.
Credentials CredentialsOf(const grpc::ServerContextBase& context);

// TLS 1.2 and 1.3, the files read again when they change, faulty ones left; in the clear without files. Outlives the
// server that listens by it.
std::shared_ptr<grpc::ServerCredentials> ServerCredentialsOf(const TlsFiles& tls);

}  // namespace orbitune
