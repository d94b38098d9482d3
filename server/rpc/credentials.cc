#include "server/rpc/credentials.h"

#include <grpc/grpc.h>
#include <grpc/grpc_security.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <mutex>

#include "server/access/credentials.h"

namespace orbitune {
namespace {

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

std::string Contents(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

// gRPC asks for the certificates at every handshake. (Its own watcher of files takes faulty ones, too, and then refuses
// everybody.)
class WatchedTls final : public grpc::ServerCredentials {
 public:
  explicit WatchedTls(const TlsFiles& files) : files_(files), watch_(files) {
    const auto clients = files.client_ca.empty() ? GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE
                                                 : GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY;
    credentials_ = grpc_ssl_server_credentials_create_with_options(  // which takes the options
        grpc_ssl_server_credentials_create_options_using_config_fetcher(clients, &WatchedTls::Fetch, this));
  }
  ~WatchedTls() override { grpc_server_credentials_release(credentials_); }

  void SetAuthMetadataProcessor(const std::shared_ptr<grpc::AuthMetadataProcessor>&) override {}

 private:
  int AddPortToServer(const std::string& address, grpc_server* server) override {
    return grpc_server_add_http2_port(server, address.c_str(), credentials_);
  }

  static grpc_ssl_certificate_config_reload_status Fetch(void* self, grpc_ssl_server_certificate_config** config) {
    return static_cast<WatchedTls*>(self)->Fetch(config);
  }

  grpc_ssl_certificate_config_reload_status Fetch(grpc_ssl_server_certificate_config** config) {
    const std::lock_guard lock(mutex_);
    if (loaded_ && !watch_.Changed()) return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_UNCHANGED;
    const std::string certificate = Contents(files_.certificate);
    const std::string key = Contents(files_.key);
    // gRPC wants authorities even where it asks clients for nothing.
    const std::string client_ca = files_.client_ca.empty() ? certificate : Contents(files_.client_ca);
    if (absl::Status status = TlsContext::Load(files_).status(); !status.ok()) {
      std::fprintf(stderr, "orbituned: grpc: the certificates stay as they were: %s\n",
                   std::string(status.message()).c_str());
      return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_UNCHANGED;
    }
    const grpc_ssl_pem_key_cert_pair pair{key.c_str(), certificate.c_str()};
    *config = grpc_ssl_server_certificate_config_create(client_ca.c_str(), &pair, 1);
    loaded_ = true;
    return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_NEW;
  }

  const TlsFiles files_;
  grpc_server_credentials* credentials_;

  std::mutex mutex_;
  // Guarded by mutex_.
  TlsFileWatch watch_;
  bool loaded_ = false;
};

}  // namespace

Credentials CredentialsOf(const grpc::ServerContextBase& context) {
  return {.token = BearerToken(Metadata(context, "authorization")),
          .session = {},
          .peer = AddressOf(context.peer()),
          .request_id = std::string(UsableRequestId(Metadata(context, "x-request-id")))};
}

std::shared_ptr<grpc::ServerCredentials> ServerCredentialsOf(const TlsFiles& tls) {
  if (!tls.on()) return grpc::InsecureServerCredentials();
  return std::make_shared<WatchedTls>(tls);
}

}  // namespace orbitune
