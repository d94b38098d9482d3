#include "core/simd/engine.h"

#include <gnu/libc-version.h>
#include <hwy/highway.h>

#include <Eigen/Core>

#include "absl/strings/str_cat.h"
#include "core/simd/lane_kernel.h"

namespace orbitune {
namespace {

#ifdef __clang__
constexpr char kCompiler[] = "clang " __clang_version__;
#else
constexpr char kCompiler[] = "g++ " __VERSION__;
#endif

std::string Libraries() {
  return absl::StrCat("glibc ", gnu_get_libc_version(), ", Highway ", HWY_MAJOR, ".", HWY_MINOR, ".", HWY_PATCH,
                      ", Eigen ", EIGEN_WORLD_VERSION, ".", EIGEN_MAJOR_VERSION, ".", EIGEN_MINOR_VERSION, ", ",
                      kCompiler);
}

}  // namespace

Engine CurrentEngine() {
  return {.version = std::string(EngineVersion()),
          .simd_target = simd::TargetInUse(),
          .fused_multiply_add = simd::TargetFuses(),
          .libraries = Libraries()};
}

}  // namespace orbitune
