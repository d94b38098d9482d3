#include "server/rpc/credentials.h"

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>

#include <algorithm>

namespace orbitune {
namespace {

constexpr unsigned kLookAgainSeconds = 1;
constexpr std::size_t kLongestRequestId = 64;

std::string_view Metadata(const grpc::ServerContextBase& context, const char* key) {
  const auto found = context.client_metadata().find(key);
  if (found == context.client_metadata().end()) return {};
  return {found->second.data(), found->second.size()};
}

// "ipv4:127.0.0.1:4711", "ipv6:%5B::1%5D:4711" without what is around the address.
std::string AddressOf(std::string peer) {
  peer.erase(0, peer.find(':') + 1);
  peer.erase(std::min(peer.rfind(':'), peer.size()));
  if (peer.starts_with("%5B")) peer.erase(0, 3);
  if (peer.ends_with("%5D")) peer.erase(peer.size() - 3);
  return peer;
}

}  // namespace

Credentials CredentialsOf(const grpc::ServerContextBase& context) {
  std::string_view token = Metadata(context, "authorization");
  for (const std::string_view scheme : {"Bearer ", "bearer "}) {
    if (token.starts_with(scheme)) token.remove_prefix(scheme.size());
  }
  const std::string_view id = Metadata(context, "x-request-id");
  const bool usable =
      id.size() <= kLongestRequestId && std::ranges::all_of(id, [](char c) { return c > ' ' && c <= '~'; });
  return {.token = token,
          .session = {},
          .peer = AddressOf(context.peer()),
          .request_id = usable ? std::string(id) : std::string()};
}

std::shared_ptr<grpc::ServerCredentials> ServerCredentialsOf(const TlsFiles& tls) {
  if (!tls.on()) return grpc::InsecureServerCredentials();
  using grpc::experimental::FileWatcherCertificateProvider;
  const auto provider =
      std::make_shared<FileWatcherCertificateProvider>(tls.key, tls.certificate, tls.client_ca, kLookAgainSeconds);
  grpc::experimental::TlsServerCredentialsOptions options(provider);
  options.watch_identity_key_cert_pairs();
  if (!tls.client_ca.empty()) {
    options.watch_root_certs();
    options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  }
  return grpc::experimental::TlsServerCredentials(options);
}

}  // namespace orbitune
