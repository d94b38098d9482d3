#include "core/base/digest.h"

#include <openssl/evp.h>

#include <memory>

#include "core/base/check.h"

namespace orbitune {
namespace {

struct Context {
  // Fetched once: that costs more than a short digest.
  Context() : context(EVP_MD_CTX_new()), algorithm(EVP_MD_fetch(nullptr, "SHA256", nullptr)) {
    ORBITUNE_CHECK(context != nullptr && algorithm != nullptr);
  }
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;
  ~Context() {
    EVP_MD_CTX_free(context);
    EVP_MD_free(algorithm);
  }
  EVP_MD_CTX* const context;
  EVP_MD* const algorithm;
};

int ValueOf(char digit) {
  if (digit >= '0' && digit <= '9') return digit - '0';
  if (digit >= 'a' && digit <= 'f') return digit - 'a' + 10;
  return -1;
}

}  // namespace

Digest Sha256(std::string_view bytes) {
  thread_local const Context sha256;
  Digest digest;
  unsigned size = 0;
  ORBITUNE_CHECK(EVP_DigestInit_ex(sha256.context, sha256.algorithm, nullptr) == 1 &&
                 EVP_DigestUpdate(sha256.context, bytes.data(), bytes.size()) == 1 &&
                 EVP_DigestFinal_ex(sha256.context, digest.data(), &size) == 1 && size == digest.size());
  return digest;
}

std::string ToHex(const Digest& digest) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (const std::uint8_t byte : digest) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

std::optional<Digest> DigestFromHex(std::string_view text) {
  Digest digest;
  if (text.size() != 2 * digest.size()) return std::nullopt;
  for (std::size_t i = 0; i < digest.size(); ++i) {
    const int high = ValueOf(text[2 * i]);
    const int low = ValueOf(text[2 * i + 1]);
    if (high < 0 || low < 0) return std::nullopt;
    digest[i] = static_cast<std::uint8_t>(16 * high + low);
  }
  return digest;
}

}  // namespace orbitune
