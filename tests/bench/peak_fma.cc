#include "tests/bench/peak_fma.h"

#include <chrono>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/bench/peak_fma.cc"
#include <hwy/foreach_target.h>
// Highway's includes must come in this order.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace orbitune::bench::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// `rounds` times twelve independent chains: enough to hide the latency. Returns how many multiply-adds that were.
double Chains(int rounds, double* sink) {
  const hn::ScalableTag<double> d;
  using V = hn::Vec<decltype(d)>;
  const V factor = hn::Set(d, 0.999999);
  const V term = hn::Set(d, 1e-6);
  // Chains of equal values would be one to the compiler.
  double start = *sink;
  const auto next = [&] { return hn::Set(d, start += 1); };
  V a = next(), b = next(), c = next(), e = next(), f = next(), g = next(), h = next(), i = next(), j = next();
  V k = next(), l = next(), m = next();
  for (int round = 0; round < rounds; ++round) {
    a = hn::MulAdd(a, factor, term);
    b = hn::MulAdd(b, factor, term);
    c = hn::MulAdd(c, factor, term);
    e = hn::MulAdd(e, factor, term);
    f = hn::MulAdd(f, factor, term);
    g = hn::MulAdd(g, factor, term);
    h = hn::MulAdd(h, factor, term);
    i = hn::MulAdd(i, factor, term);
    j = hn::MulAdd(j, factor, term);
    k = hn::MulAdd(k, factor, term);
    l = hn::MulAdd(l, factor, term);
    m = hn::MulAdd(m, factor, term);
  }
  const V sum = hn::Add(hn::Add(hn::Add(a, b), hn::Add(c, e)),
                        hn::Add(hn::Add(hn::Add(f, g), hn::Add(h, i)), hn::Add(hn::Add(j, k), hn::Add(l, m))));
  *sink = hn::GetLane(hn::SumOfLanes(d, sum));
  return 12.0 * rounds * static_cast<double>(hn::Lanes(d));
}

}  // namespace orbitune::bench::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace orbitune::bench {

HWY_EXPORT(Chains);

double PeakFmaPerSecond() {
  double best = 0;
  volatile double kept = 0;
  for (int repeat = 0; repeat < 10; ++repeat) {
    double sink = 0;
    const auto begin = std::chrono::steady_clock::now();
    const double count = HWY_DYNAMIC_DISPATCH(Chains)(400'000, &sink);
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - begin;
    kept = kept + sink;
    best = std::max(best, count / elapsed.count());
  }
  return best;
}

}  // namespace orbitune::bench
#endif  // HWY_ONCE
