#include "client/cli/parse.h"

#include <array>
#include <random>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/cli/number.h"

namespace orbitune::cli {

absl::StatusOr<v1::Gains> ParseGains(const std::string& text) {
  const std::vector<std::string> parts = absl::StrSplit(text, ',');
  std::array<double, 5> k{};
  if (parts.size() != k.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' holds ", parts.size(), " values; 5 are needed, as in 0.1,1,1,1,10"));
  }
  for (std::size_t i = 0; i < k.size(); ++i) {
    const absl::StatusOr<double> value = ParseNumber<double>(parts[i]);
    if (!value.ok()) return value.status();
    k[i] = *value;
  }
  v1::Gains gains;
  gains.set_k1(k[0]);
  gains.set_k2(k[1]);
  gains.set_k3(k[2]);
  gains.set_k4(k[3]);
  gains.set_k5(k[4]);
  return gains;
}

absl::StatusOr<std::pair<std::string, std::string>> ParsePair(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0) {
    return absl::InvalidArgumentError(absl::StrCat("'", text, "' is not of the form key=value"));
  }
  return std::make_pair(text.substr(0, equals), text.substr(equals + 1));
}

std::string ResourceName(const std::string& collection, const std::string& text) {
  if (text.empty() || absl::StartsWith(text, absl::StrCat(collection, "/"))) return text;
  return absl::StrCat(collection, "/", text);
}

std::string RandomUuid() {
  std::random_device device;
  const unsigned a = device(), b = device(), c = device(), d = device();
  return absl::StrFormat("%08x-%04x-4%03x-%04x-%04x%08x", a, b >> 16, b & 0xfff, (c >> 16 & 0x3fff) | 0x8000,
                         c & 0xffff, d);
}

}  // namespace orbitune::cli
