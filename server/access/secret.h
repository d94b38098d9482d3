// Tokens as they are shown once and sent with every call: "orb_ID_SECRET". The secret is 256 random bits, so its
// SHA-256 is all that has to be kept: there is no dictionary to try against it, which a slow hash would be for.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace orbitune {

struct Secret {
  std::string text;    // "orb_abcd2345_..."; never to be logged or stored
  std::string id;      // "abcd2345"
  std::string digest;  // of the text, in hexadecimal

  static Secret New();
};

// The id of what looks like a token; nothing for anything else.
std::optional<std::string> SecretId(std::string_view text);

// Whether the text's digest is this one, in a time that does not depend on where they differ.
bool HasDigest(std::string_view text, std::string_view digest);

}  // namespace orbitune
