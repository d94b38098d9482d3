// The server's side of TLS: certificates from files that may be replaced while it runs. HTTP's connections are made
// here; gRPC makes its own, from files that are checked here.
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

// Tells when the files have changed. For one thread at a time.
class TlsFileWatch {
 public:
  explicit TlsFileWatch(TlsFiles files);

  // Whether they are others than when this was last asked, or made; looks once a second at most.
  bool Changed();

 private:
  std::string Stamp() const;

  const TlsFiles files_;
  std::string stamp_;
  std::chrono::steady_clock::time_point looked_;
};

// For one thread at a time.
class TlsContext {
 public:
  // TLS 1.2 and 1.3 with forward secrecy and authenticated encryption. INVALID_ARGUMENT naming the option whose file
  // cannot be used: unreadable, no PEM, a key that is not the certificate's, an expired certificate.
  static absl::StatusOr<std::unique_ptr<TlsContext>> Load(const TlsFiles& files);
  ~TlsContext();

  // For a new connection, whose it is from then on. Files that have changed are read again first; where the new ones
  // are faulty the last good ones stay, and `log` is told.
  ssl_st* NewConnection(const std::function<void(const std::string&)>& log);

 private:
  struct FreeContext {
    void operator()(ssl_ctx_st* context) const;
  };
  using Context = std::unique_ptr<ssl_ctx_st, FreeContext>;

  TlsContext(TlsFiles files, TlsFileWatch watch, Context context);
  static absl::StatusOr<Context> Make(const TlsFiles& files);

  const TlsFiles files_;
  TlsFileWatch watch_;
  Context context_;
};

}  // namespace orbitune
