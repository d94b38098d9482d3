#include "server/access/secret.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/rand.h>

#include <array>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"

namespace orbitune {
namespace {

constexpr std::string_view kPrefix = "orb_";
constexpr std::string_view kAlphabet = "abcdefghijklmnopqrstuvwxyz234567";  // 5 bits a letter
constexpr std::size_t kIdLetters = 8;
constexpr std::size_t kSecretLetters = 52;  // of 260 bits

std::string RandomLetters(std::size_t count) {
  std::string letters(count, '\0');
  ORBITUNE_CHECK(RAND_bytes(reinterpret_cast<unsigned char*>(letters.data()), static_cast<int>(count)) == 1);
  for (char& letter : letters) letter = kAlphabet[static_cast<unsigned char>(letter) % kAlphabet.size()];
  return letters;
}

std::string DigestOf(std::string_view text) {
  std::array<unsigned char, 32> bytes{};
  ORBITUNE_CHECK(EVP_Digest(text.data(), text.size(), bytes.data(), nullptr, EVP_sha256(), nullptr) == 1);
  return absl::BytesToHexString({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

}  // namespace

Secret Secret::New() {
  Secret secret;
  secret.id = RandomLetters(kIdLetters);
  secret.text = absl::StrCat(std::string(kPrefix), secret.id, "_", RandomLetters(kSecretLetters));
  secret.digest = DigestOf(secret.text);
  return secret;
}

std::optional<std::string> SecretId(std::string_view text) {
  const std::size_t begin = kPrefix.size();
  if (text.size() != begin + kIdLetters + 1 + kSecretLetters || !text.starts_with(kPrefix)) return std::nullopt;
  if (text[begin + kIdLetters] != '_') return std::nullopt;
  return std::string(text.substr(begin, kIdLetters));
}

bool HasDigest(std::string_view text, std::string_view digest) {
  const std::string own = DigestOf(text);
  return own.size() == digest.size() && CRYPTO_memcmp(own.data(), digest.data(), own.size()) == 0;
}

}  // namespace orbitune
