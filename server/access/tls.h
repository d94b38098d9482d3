// The server's side of TLS for HTTP: certificates from files that may be replaced while it runs. gRPC watches the same
// files by itself.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "core/base/status.h"

struct ssl_ctx_st;
struct ssl_st;

namespace orbitune {

struct TlsFiles {
  std::string certificate;  // PEM: the server's, then what leads to its root; empty: no TLS
  std::string key;          // PEM
  std::string client_ca;    // PEM: clients must have a certificate that leads to one of these; empty: they need none

  bool on() const { return !certificate.empty(); }
};

// For one thread at a time.
class TlsContext {
 public:
  // TLS 1.2 and 1.3 with forward secrecy and authenticated encryption. INVALID_ARGUMENT naming the option whose file
  // cannot be used: unreadable, no PEM, a key that is not the certificate's, an expired certificate.
  static absl::StatusOr<std::unique_ptr<TlsContext>> Load(const TlsFiles& files);
  ~TlsContext();

  // For a new connection, whose it is from then on. Files that have changed are read again first, looked at once a
  // second at most; where the new ones are faulty the last good ones stay, and `log` is told.
  ssl_st* NewConnection(const std::function<void(const std::string&)>& log);

 private:
  struct FreeContext {
    void operator()(ssl_ctx_st* context) const;
  };
  using Context = std::unique_ptr<ssl_ctx_st, FreeContext>;

  TlsContext(TlsFiles files, Context context);
  static absl::StatusOr<Context> Make(const TlsFiles& files);
  std::string Stamp() const;

  const TlsFiles files_;
  Context context_;
  std::string stamp_;  // of the files when they were last read
  std::chrono::steady_clock::time_point looked_;
};

}  // namespace orbitune
