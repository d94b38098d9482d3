// SHA-256 (FIPS 180-4, by libcrypto): what content is known by, and what a job's history is chained with.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace orbitune {

using Digest = std::array<std::uint8_t, 32>;

Digest Sha256(std::string_view bytes);

// 64 hexadecimal digits in lower case, and back; nothing for any other text.
std::string ToHex(const Digest& digest);
std::optional<Digest> DigestFromHex(std::string_view text);

}  // namespace orbitune
