// Which Orbitune this is: stored with results, so that one knows what made them.
#pragma once

#include <string>
#include <string_view>

namespace orbitune {

// "0.1.0".
std::string_view EngineVersion();

// What computed a result, as far as its bits may depend on it.
struct Engine {
  std::string version;              // EngineVersion()
  std::string simd_target;          // "avx512", "avx2", "baseline"
  bool fused_multiply_add = false;  // targets that are alike in this give the same bits
  std::string libraries;            // "glibc 2.36, Highway 1.0.3, ..."

  bool operator==(const Engine&) const = default;
};

}  // namespace orbitune
