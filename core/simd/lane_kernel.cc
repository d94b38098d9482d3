#include "core/simd/lane_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/simd/lane_kernel.cc"
#include <hwy/foreach_target.h>
// Highway's includes must come in this order.
#include "core/simd/lane_kernel-inl.h"

#if HWY_ONCE
#include <atomic>
#include <cstdint>
#include <iterator>

namespace orbitune::simd {

HWY_EXPORT(Run);
HWY_EXPORT(Count);
HWY_EXPORT(Fuses);

namespace {

struct Target {
  const char* name;
  std::int64_t bits;
};

// What this file is compiled for (HWY_DISABLED_TARGETS in core/CMakeLists.txt), the best first.
constexpr Target kTargets[] = {{"avx512", HWY_AVX3}, {"avx2", HWY_AVX2}, {"baseline", HWY_STATIC_TARGET}};

bool IsSupported(const Target& target) { return (hwy::SupportedTargets() & HWY_TARGETS & target.bits) != 0; }

// nullptr: the best supported.
std::atomic<const Target*> chosen_target = nullptr;

const Target& InUse() {
  const Target* chosen = chosen_target;
  if (chosen != nullptr) return *chosen;
  for (const Target& target : kTargets) {
    if (IsSupported(target)) return target;
  }
  return kTargets[std::size(kTargets) - 1];
}

}  // namespace

LaneUse RunLanes(const LaneEpisode* episodes, LaneResult* results, std::size_t n, const Interrupt& interrupt) {
  return HWY_DYNAMIC_DISPATCH(Run)(episodes, results, n, interrupt);
}

bool TargetFuses() { return HWY_DYNAMIC_DISPATCH(Fuses)(); }

std::size_t LaneCount() { return HWY_DYNAMIC_DISPATCH(Count)(); }

std::vector<std::string> SupportedTargets() {
  std::vector<std::string> names;
  for (const Target& target : kTargets) {
    if (IsSupported(target)) names.emplace_back(target.name);
  }
  return names;
}

std::string TargetInUse() { return InUse().name; }

bool UseTarget(const std::string& name) {
  if (name == "auto") {
    chosen_target = nullptr;
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    return true;
  }
  for (const Target& target : kTargets) {
    if (name != target.name || !IsSupported(target)) continue;
    chosen_target = &target;
    hwy::GetChosenTarget().Update(target.bits);
    return true;
  }
  return false;
}

}  // namespace orbitune::simd
#endif  // HWY_ONCE
