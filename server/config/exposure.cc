#include "server/config/exposure.h"

#include <arpa/inet.h>
#include <netdb.h>

#include <memory>

#include "absl/strings/str_cat.h"

namespace orbitune {
namespace {

bool IsLoopback(const sockaddr& address) {
  if (address.sa_family == AF_INET) {
    return ntohl(reinterpret_cast<const sockaddr_in&>(address).sin_addr.s_addr) >> 24 == 127;
  }
  const auto& bytes = reinterpret_cast<const sockaddr_in6&>(address).sin6_addr;
  return address.sa_family == AF_INET6 && IN6_IS_ADDR_LOOPBACK(&bytes) != 0;
}

// What cannot be resolved is taken for open: listening will tell what is wrong with it.
bool IsOpen(const std::string& host_port) {
  std::string host = host_port.substr(0, host_port.rfind(':'));
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (getaddrinfo(host.c_str(), nullptr, &hints, &found) != 0) return true;
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(found, freeaddrinfo);
  for (const addrinfo* each = found; each != nullptr; each = each->ai_next) {
    if (!IsLoopback(*each->ai_addr)) return true;
  }
  return false;
}

}  // namespace

absl::Status CheckExposure(const ServerConfig& config, bool has_tokens) {
  const bool has_tls = !config.tls_cert.empty();
  if (config.insecure || (has_tls && has_tokens)) return absl::OkStatus();
  for (const auto& [option, address] : {std::pair("--listen", config.listen), std::pair("--http", config.http)}) {
    if (address == "off" || !IsOpen(address)) continue;
    return absl::FailedPreconditionError(absl::StrCat(
        option, " ", address, " is open to other machines, but ",
        has_tls      ? "there are no tokens"
        : has_tokens ? "there is no TLS"
                     : "there are neither TLS nor tokens",
        ". Ways forward: listen on 127.0.0.1 (other machines by an SSH tunnel or a proxy with TLS);",
        has_tls ? "" : " give --tls-cert and --tls-key;",
        has_tokens ? ""
                   : absl::StrCat(" make a token: orbituned token create --name NAME --role admin --data-dir ",
                                  config.data_dir, ";"),
        " or say --insecure, and whoever reaches the address may ", has_tokens ? "read what passes" : "do all"));
  }
  return absl::OkStatus();
}

}  // namespace orbitune
