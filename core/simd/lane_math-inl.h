// Functions of a vector of doubles that the kernel needs, compiled once for each instruction set; the same bits on all
// that have a fused multiply-add.
#if defined(ORBITUNE_CORE_SIMD_LANE_MATH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ORBITUNE_CORE_SIMD_LANE_MATH_INL_H_
#undef ORBITUNE_CORE_SIMD_LANE_MATH_INL_H_
#else
#define ORBITUNE_CORE_SIMD_LANE_MATH_INL_H_
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace orbitune::simd::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<double>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;

constexpr D kD;

HWY_INLINE V Set(double value) { return hn::Set(kD, value); }

// sin and cos of an angle of up to 1e6 rad, to 1 ulp or so: reduction to [-pi/4, pi/4] by a three-part pi/2, then the
// Taylor series, whose first neglected term is below 2^-53 there.
struct SinCos {
  V sin, cos;
};

HWY_INLINE SinCos SinCosOf(V angle) {
  const V quadrant = hn::Round(hn::Mul(angle, Set(0.63661977236758134308)));
  V r = hn::NegMulAdd(quadrant, Set(0x1.921fb54400000p0), angle);
  r = hn::NegMulAdd(quadrant, Set(0x1.0b4611a600000p-34), r);
  r = hn::NegMulAdd(quadrant, Set(0x1.3198a2e037073p-69), r);
  const V r2 = hn::Mul(r, r);
  V s = Set(1.0 / 355687428096000.0);
  s = hn::MulAdd(s, r2, Set(-1.0 / 1307674368000.0));
  s = hn::MulAdd(s, r2, Set(1.0 / 6227020800.0));
  s = hn::MulAdd(s, r2, Set(-1.0 / 39916800.0));
  s = hn::MulAdd(s, r2, Set(1.0 / 362880.0));
  s = hn::MulAdd(s, r2, Set(-1.0 / 5040.0));
  s = hn::MulAdd(s, r2, Set(1.0 / 120.0));
  s = hn::MulAdd(s, r2, Set(-1.0 / 6.0));
  s = hn::MulAdd(hn::Mul(s, r2), r, r);
  V c = Set(-1.0 / 6402373705728000.0);
  c = hn::MulAdd(c, r2, Set(1.0 / 20922789888000.0));
  c = hn::MulAdd(c, r2, Set(-1.0 / 87178291200.0));
  c = hn::MulAdd(c, r2, Set(1.0 / 479001600.0));
  c = hn::MulAdd(c, r2, Set(-1.0 / 3628800.0));
  c = hn::MulAdd(c, r2, Set(1.0 / 40320.0));
  c = hn::MulAdd(c, r2, Set(-1.0 / 720.0));
  c = hn::MulAdd(c, r2, Set(1.0 / 24.0));
  c = hn::MulAdd(c, r2, Set(-0.5));
  c = hn::MulAdd(c, r2, Set(1.0));
  const V turn = hn::NegMulAdd(Set(4.0), hn::Floor(hn::Mul(quadrant, Set(0.25))), quadrant);  // 0, 1, 2 or 3
  const M odd = hn::Or(hn::Eq(turn, Set(1.0)), hn::Eq(turn, Set(3.0)));
  const V sine = hn::IfThenElse(odd, c, s);
  const V cosine = hn::IfThenElse(odd, s, c);
  return {hn::IfThenElse(hn::Ge(turn, Set(2.0)), hn::Neg(sine), sine),
          hn::IfThenElse(hn::Or(hn::Eq(turn, Set(1.0)), hn::Eq(turn, Set(2.0))), hn::Neg(cosine), cosine)};
}

// Within 6 %, for step sizes: the exponent and a linear mantissa, of which 20 bits are used. The logarithm is exact
// in these bits, grows with x, and is above 1023 for what is not a number.
constexpr double kLogScale = 0x1p-20;
constexpr double kLogOffset = -(0x1p32 + 1023);
HWY_INLINE V LogBits(V x) {  // (log2(x) - kLogOffset) / kLogScale
  const hn::RebindToUnsigned<D> du;
  return hn::BitCast(kD, hn::Or(hn::ShiftRight<32>(hn::BitCast(du, x)), hn::BitCast(du, Set(0x1p52))));
}
HWY_INLINE V RoughLog2(V x) { return hn::MulAdd(LogBits(x), Set(kLogScale), Set(kLogOffset)); }

HWY_INLINE V RoughExp2(V x) {  // x from -1023 to 1023
  const hn::RebindToUnsigned<D> du;
  return hn::BitCast(kD, hn::ShiftLeft<32>(hn::BitCast(du, hn::Add(x, Set(0x1.8p32 + 1023)))));
}

}  // namespace orbitune::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
