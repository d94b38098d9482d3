// Whether what the server listens on is open to others than this machine, and with what protection.
#pragma once

#include "core/base/status.h"
#include "server/config/config.h"

namespace orbitune {

// FAILED_PRECONDITION, with every way forward, where an address is not loopback and TLS or tokens are missing, unless
// --insecure was said. has_tokens: the server asks for them.
absl::Status CheckExposure(const ServerConfig& config, bool has_tokens);

}  // namespace orbitune
