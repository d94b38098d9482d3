#include "server/access/tls.h"

#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <sys/stat.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"

namespace orbitune {
namespace {

// Of TLS 1.2; those of 1.3 are all of this kind.
constexpr char kCiphers[] = "ECDHE+AESGCM:ECDHE+CHACHA20";

absl::Status Fault(const char* option, const std::string& file, std::string_view what) {
  const unsigned long code = ERR_peek_last_error();
  const char* const reason = code == 0 ? nullptr : ERR_reason_error_string(code);
  ERR_clear_error();
  return absl::InvalidArgumentError(
      absl::StrCat(option, " ", file, ": ", ToAbsl(what), reason == nullptr ? "" : absl::StrCat(" (", reason, ")")));
}

// The protocol of HTTP/1.1, for clients that ask which one is spoken.
int ChooseHttp11(SSL*, const unsigned char** out, unsigned char* out_size, const unsigned char* offered,
                 unsigned offered_size, void*) {
  static constexpr unsigned char kHttp11[] = "\x08http/1.1";
  unsigned char* chosen = nullptr;
  const int result = SSL_select_next_proto(&chosen, out_size, kHttp11, sizeof kHttp11 - 1, offered, offered_size);
  *out = chosen;
  return result == OPENSSL_NPN_NEGOTIATED ? SSL_TLSEXT_ERR_OK : SSL_TLSEXT_ERR_NOACK;
}

}  // namespace

void TlsContext::FreeContext::operator()(ssl_ctx_st* context) const { SSL_CTX_free(context); }

TlsFileWatch::TlsFileWatch(TlsFiles files) : files_(std::move(files)), stamp_(Stamp()), looked_() {}

std::string TlsFileWatch::Stamp() const {
  std::string stamp;
  for (const std::string& file : {files_.certificate, files_.key, files_.client_ca}) {
    struct stat about {};
    if (file.empty() || stat(file.c_str(), &about) != 0) continue;
    absl::StrAppend(&stamp, about.st_ino, " ", about.st_mtim.tv_sec, ".", about.st_mtim.tv_nsec, " ", about.st_size,
                    "\n");
  }
  return stamp;
}

bool TlsFileWatch::Changed() {
  const auto now = std::chrono::steady_clock::now();
  if (now < looked_ + std::chrono::seconds(1)) return false;
  looked_ = now;
  std::string stamp = Stamp();
  if (stamp == stamp_) return false;
  stamp_ = std::move(stamp);
  return true;
}

TlsContext::TlsContext(TlsFiles files, TlsFileWatch watch, Context context)
    : files_(std::move(files)), watch_(std::move(watch)), context_(std::move(context)) {}

TlsContext::~TlsContext() = default;

absl::StatusOr<std::unique_ptr<TlsContext>> TlsContext::Load(const TlsFiles& files) {
  TlsFileWatch watch(files);  // before they are read
  auto context = Make(files);
  if (!context.ok()) return context.status();
  return std::unique_ptr<TlsContext>(new TlsContext(files, std::move(watch), *std::move(context)));
}

absl::StatusOr<TlsContext::Context> TlsContext::Make(const TlsFiles& files) {
  ERR_clear_error();
  Context context(SSL_CTX_new(TLS_server_method()));
  SSL_CTX* const c = context.get();
  ORBITUNE_CHECK(c != nullptr && SSL_CTX_set_min_proto_version(c, TLS1_2_VERSION) == 1);
  ORBITUNE_CHECK(SSL_CTX_set_cipher_list(c, kCiphers) == 1);
  SSL_CTX_set_options(c, SSL_OP_NO_COMPRESSION | SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_TICKET);
  SSL_CTX_set_session_cache_mode(c, SSL_SESS_CACHE_OFF);  // each connection shows its certificate
  SSL_CTX_set_mode(c, SSL_MODE_RELEASE_BUFFERS);          // many connections wait
  SSL_CTX_set_alpn_select_cb(c, ChooseHttp11, nullptr);
  if (SSL_CTX_use_certificate_chain_file(c, files.certificate.c_str()) != 1) {
    return Fault("--tls-cert", files.certificate, "no certificate in PEM that can be read");
  }
  if (X509_cmp_current_time(X509_get0_notAfter(SSL_CTX_get0_certificate(c))) <= 0) {
    return Fault("--tls-cert", files.certificate, "the certificate has expired");
  }
  // Checks that it is the certificate's.
  if (SSL_CTX_use_PrivateKey_file(c, files.key.c_str(), SSL_FILETYPE_PEM) != 1) {
    return Fault("--tls-key", files.key, "not the certificate's key, or none in PEM that can be read");
  }
  if (files.client_ca.empty()) return context;
  STACK_OF(X509_NAME)* const names = SSL_load_client_CA_file(files.client_ca.c_str());
  if (names == nullptr || SSL_CTX_load_verify_locations(c, files.client_ca.c_str(), nullptr) != 1) {
    sk_X509_NAME_pop_free(names, X509_NAME_free);
    return Fault("--tls-client-ca", files.client_ca, "no certificates in PEM that can be read");
  }
  SSL_CTX_set_client_CA_list(c, names);
  SSL_CTX_set_verify(c, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, nullptr);
  return context;
}

ssl_st* TlsContext::NewConnection(const std::function<void(const std::string&)>& log) {
  if (watch_.Changed()) {
    auto context = Make(files_);
    if (context.ok()) context_ = *std::move(context);
    log(context.ok() ? "certificates read again"
                     : absl::StrCat("the certificates stay as they were: ", context.status().message()));
  }
  ssl_st* const connection = SSL_new(context_.get());
  ORBITUNE_CHECK(connection != nullptr);
  return connection;
}

}  // namespace orbitune
