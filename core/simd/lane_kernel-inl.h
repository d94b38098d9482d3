// The kernel itself, compiled once for each instruction set (Highway's foreach_target). Every operation is written out,
// fused or not, so that all targets with a fused multiply-add give the same bits.
#if defined(ORBITUNE_CORE_SIMD_LANE_KERNEL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ORBITUNE_CORE_SIMD_LANE_KERNEL_INL_H_
#undef ORBITUNE_CORE_SIMD_LANE_KERNEL_INL_H_
#else
#define ORBITUNE_CORE_SIMD_LANE_KERNEL_INL_H_
#endif

#include <hwy/highway.h>

#include "core/simd/lane_kernel.h"

HWY_BEFORE_NAMESPACE();
namespace orbitune::simd::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<double>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;

constexpr D kD;
constexpr std::size_t kWidth = hn::MaxLanes(D());

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

// Within 6 %, for step sizes: the exponent and a linear mantissa.
HWY_INLINE V RoughLog2(V x) {
  const hn::RebindToSigned<D> di;
  return hn::MulAdd(hn::ConvertTo(kD, hn::BitCast(di, x)), Set(0x1p-52), Set(-1023.0));
}

HWY_INLINE V RoughExp2(V x) {
  const hn::RebindToSigned<D> di;
  return hn::BitCast(kD, hn::ConvertTo(di, hn::Mul(hn::Add(x, Set(1023.0)), Set(0x1p52))));
}

// What is integrated: x1..x6 and the target's longitude L_r, and, within a step only, the sines and cosines of x1 and
// L_r, which satisfy differential equations of their own: so a step of six stages needs two sincos, not twelve.
enum Component : std::size_t { kX1, kX2, kX3, kX4, kX5, kX6, kL, kS1, kC1, kSL, kCL, kComponents };
constexpr std::size_t kIntegrated = 7;

// `kVectors` vectors of episodes side by side, which hide each other's latencies.
template <std::size_t kVectors>
struct Kernel {
  static constexpr std::size_t kLanes = kWidth * kVectors;
  using Row = double[kLanes];

  // The episodes in flight, a row for each quantity, a column for each lane.
  struct alignas(64) Lanes {
    // Constant during an episode.
    Row k1, k2, k3, k4, k5, ex, ey, hx, hy;
    Row sampling_period, horizon, distance2, settled_below, control_scale, tolerance, size_floor, max_attempts;
    // At the newest accepted state.
    Row y[kComponents];
    Row rate[kComponents];             // the first stage of the next step
    Row z, normal;                     // x4 - xi, u_h
    Row time, step, log_error, grown;  // grown: the growth that the next step may have: 1 after a rejection
    Row sample, attempts, rejected;
    // The cost so far.
    Row settling, fuel, settling_fuel, outside, first_lyapunov;
    Row end;                      // kFlying, ...
    std::size_t episode[kLanes];  // which one a lane flies
  };

  // How a lane's episode stands, as the numbers that a row holds.
  static constexpr double kFlying = 0, kAtRest = 1, kAtEdge = 2, kStuck = 3, kIdle = 4;

  struct Gains5 {
    V k1, k2, k3, k4, k5, ex, ey, hx, hy;
  };

  static HWY_INLINE Gains5 LoadConstants(const Lanes& l, std::size_t at) {
    return {hn::Load(kD, l.k1 + at), hn::Load(kD, l.k2 + at), hn::Load(kD, l.k3 + at),
            hn::Load(kD, l.k4 + at), hn::Load(kD, l.k5 + at), hn::Load(kD, l.ex + at),
            hn::Load(kD, l.ey + at), hn::Load(kD, l.hx + at), hn::Load(kD, l.hy + at)};
  }

  struct LoopValue {
    V margin;     // min(a, 1 + x2): positive in the domain
    V z, normal;  // x4 - xi, u_h
  };

  // The closed loop (core/control/control_law.cc) with u substituted: 85 operations, one division, no root, no sine.
  // Writes dy/dt of every component to rate[.][at].
  static HWY_INLINE LoopValue ClosedLoop(const Gains5& g, const V* HWY_RESTRICT y, Row* HWY_RESTRICT rate,
                                         std::size_t at) {
    const V x2 = y[kX2], x3 = y[kX3], x4 = y[kX4], x5 = y[kX5], x6 = y[kX6];
    const V s1 = y[kS1], c1 = y[kC1], sl = y[kSL], cl = y[kCL];
    const V one = Set(1.0);
    const V zx = hn::MulAdd(g.ex, cl, hn::Mul(g.ey, sl));
    const V zy = hn::MulSub(g.ex, sl, hn::Mul(g.ey, cl));
    const V q = hn::Add(one, zx);
    const V n = hn::Mul(q, q);
    const V a = hn::Add(x3, q);
    const V m = hn::Add(one, x2);
    const V inv_am = hn::Div(one, hn::Mul(a, m));
    const V inv_a = hn::Mul(inv_am, m);
    const V inv_f12 = hn::Mul(inv_a, inv_a);
    const V f12 = hn::Mul(a, a);
    const V f13 = hn::Add(a, q);
    const V f33 = hn::Mul(f13, zy);
    const V f42 = hn::Mul(hn::Add(one, m), hn::Mul(f12, a));
    const V damping = hn::Sub(g.k3, f33);
    const V k1s1 = hn::Mul(g.k1, s1);
    const V xi = hn::Mul(hn::MulAdd(f13, k1s1, hn::Mul(damping, x3)), inv_f12);
    const V rate1 = hn::MulAdd(f12, x2, hn::Mul(f13, x3));
    const V rate3 = hn::NegMulSub(f33, x3, hn::Mul(f12, x4));
    const V zx_rate = hn::Neg(hn::Mul(zy, n));
    const V zy_rate = hn::Mul(zx, n);
    const V half_f12_rate = hn::Add(rate3, zx_rate);  // over a
    const V f13_rate = hn::Add(half_f12_rate, zx_rate);
    const V f33_rate = hn::MulAdd(f13_rate, zy, hn::Mul(f13, zy_rate));
    const V f13c1 = hn::Mul(f13, c1);
    const V n_rate = hn::MulAdd(g.k1, hn::MulAdd(f13_rate, s1, hn::Mul(f13c1, rate1)),
                                hn::NegMulAdd(f33_rate, x3, hn::Mul(damping, rate3)));
    const V f12_rate = hn::Mul(hn::Add(a, a), half_f12_rate);
    const V xi_rate = hn::Mul(hn::NegMulAdd(xi, f12_rate, n_rate), inv_f12);
    const V z = hn::Sub(x4, xi);

    const V s = hn::MulAdd(s1, cl, hn::Mul(c1, sl));
    const V c = hn::NegMulAdd(s1, sl, hn::Mul(c1, cl));
    const V hx = hn::Add(x5, g.hx);
    const V hy = hn::Add(x6, g.hy);
    const V half = hn::Mul(hn::Mul(Set(0.5), inv_am), hn::MulAdd(hx, hx, hn::MulAdd(hy, hy, one)));
    const V h5 = hn::Mul(half, c);
    const V h6 = hn::Mul(half, s);
    const V h1 = hn::Mul(inv_am, hn::NegMulAdd(hy, c, hn::Mul(hx, s)));
    const V planar = hn::Mul(g.k1, hn::NegMulAdd(hn::Mul(z, inv_f12), f13c1, s1));
    const V v_h = hn::MulAdd(h1, planar, hn::MulAdd(x5, h5, hn::Mul(x6, h6)));
    const V normal = hn::Neg(hn::Mul(g.k5, v_h));

    const V dx1 = hn::MulAdd(h1, normal, rate1);
    const V dx2 = hn::Neg(hn::MulAdd(f12, k1s1, hn::MulAdd(f42, z, hn::Mul(g.k2, x2))));
    const V dx4 = hn::MulAdd(f42, x2, hn::MulAdd(f12, x3, hn::NegMulAdd(g.k4, z, xi_rate)));
    hn::Store(dx1, kD, rate[kX1] + at);
    hn::Store(dx2, kD, rate[kX2] + at);
    hn::Store(rate3, kD, rate[kX3] + at);
    hn::Store(dx4, kD, rate[kX4] + at);
    hn::Store(hn::Mul(h5, normal), kD, rate[kX5] + at);
    hn::Store(hn::Mul(h6, normal), kD, rate[kX6] + at);
    hn::Store(n, kD, rate[kL] + at);
    hn::Store(hn::Mul(c1, dx1), kD, rate[kS1] + at);
    hn::Store(hn::Neg(hn::Mul(s1, dx1)), kD, rate[kC1] + at);
    hn::Store(hn::Mul(cl, n), kD, rate[kSL] + at);
    hn::Store(hn::Neg(hn::Mul(sl, n)), kD, rate[kCL] + at);
    return {hn::Min(a, m), z, normal};
  }

  // The state at y with its sines and cosines, as exact as they come.
  static HWY_INLINE void Project(V* y) {
    const SinCos first = SinCosOf(y[kX1]);
    const SinCos target = SinCosOf(y[kL]);
    y[kS1] = first.sin;
    y[kC1] = first.cos;
    y[kSL] = target.sin;
    y[kCL] = target.cos;
  }

  // Dormand and Prince 1980, RK5(4)7M, as in core/sim/scalar_simulator.cc.
  static constexpr std::size_t kStages = 7;
  static constexpr double kA[kStages][kStages - 1] = {
      {},
      {1.0 / 5},
      {3.0 / 40, 9.0 / 40},
      {44.0 / 45, -56.0 / 15, 32.0 / 9},
      {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
      {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
      {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84},
  };
  static constexpr double kE[kStages] = {71.0 / 57600,      0,          -71.0 / 16695, 71.0 / 1920,
                                         -17253.0 / 339200, 22.0 / 525, -1.0 / 40};

  template <std::size_t kStage>
  static HWY_INLINE V Combine(const Row (*k)[kComponents], std::size_t component, std::size_t at) {
    V sum = hn::Mul(Set(kA[kStage][0]), hn::Load(kD, k[0][component] + at));
    for (std::size_t j = 1; j < kStage; ++j) {
      if (kA[kStage][j] == 0) continue;
      sum = hn::MulAdd(Set(kA[kStage][j]), hn::Load(kD, k[j][component] + at), sum);
    }
    return sum;
  }

  // What one attempt of a step needs beside the lanes: an array for each vector.
  struct Attempt {
    V h[kVectors], remaining_time[kVectors], next_sample_time[kVectors];
    M last[kVectors];
    V margin[kVectors];
  };

  template <std::size_t kStage>
  static HWY_INLINE void Stage(const Lanes& l, Row (*k)[kComponents], Attempt& attempt, V (*y)[kComponents], V* z,
                               V* normal) {
    for (std::size_t v = 0; v < kVectors; ++v) {
      const std::size_t at = v * kWidth;
      const std::size_t count = kStage == kStages - 1 ? kIntegrated : kComponents;
      for (std::size_t i = 0; i < count; ++i) {
        y[v][i] = hn::MulAdd(attempt.h[v], Combine<kStage>(k, i, at), hn::Load(kD, l.y[i] + at));
      }
      if (kStage == kStages - 1) Project(y[v]);
      const LoopValue value = ClosedLoop(LoadConstants(l, at), y[v], k[kStage], at);
      attempt.margin[v] = hn::Min(attempt.margin[v], value.margin);
      z[v] = value.z;
      normal[v] = value.normal;
    }
  }

  // V(x), the squared distance against epsilon^2, and ||u|| in the cost's unit, of the accepted state of vector `at`.
  struct SampleValue {
    V lyapunov, control;
    M outside;
  };

  static HWY_INLINE SampleValue ValueAtSample(const Lanes& l, std::size_t at) {
    const auto y = [&](Component i) HWY_ATTR { return hn::Load(kD, l.y[i] + at); };
    const Gains5 g = LoadConstants(l, at);
    const V one = Set(1.0);
    const V x2 = y(kX2), x3 = y(kX3), x5 = y(kX5), x6 = y(kX6), s1 = y(kS1), c1 = y(kC1), sl = y(kSL), cl = y(kCL);
    const V z = hn::Load(kD, l.z + at);
    const V squares = hn::MulAdd(x2, x2, hn::MulAdd(x3, x3, hn::MulAdd(z, z, hn::MulAdd(x5, x5, hn::Mul(x6, x6)))));
    SampleValue value;
    value.lyapunov = hn::MulAdd(g.k1, hn::Sub(one, c1), hn::Mul(Set(0.5), squares));

    // u from the closed loop's rates: x4' = f42 x2 + (f12 + f43) x3 + u_r, x2' = u_theta / a.
    const V zx = hn::MulAdd(g.ex, cl, hn::Mul(g.ey, sl));
    const V q = hn::Add(one, zx);
    const V a = hn::Add(x3, q);
    const V f12 = hn::Mul(a, a);
    const V f42 = hn::Mul(hn::Add(Set(2.0), x2), hn::Mul(f12, a));
    const V f12_43 = hn::MulAdd(hn::Add(a, q), zx, f12);
    const V radial = hn::NegMulAdd(f42, x2, hn::NegMulAdd(f12_43, x3, hn::Load(kD, l.rate[kX4] + at)));
    const V transverse = hn::Mul(a, hn::Load(kD, l.rate[kX2] + at));
    const V normal = hn::Load(kD, l.normal + at);
    const V norm2 = hn::MulAdd(radial, radial, hn::MulAdd(transverse, transverse, hn::Mul(normal, normal)));
    value.control = hn::Mul(hn::Sqrt(norm2), hn::Load(kD, l.control_scale + at));

    // y <= epsilon, multiplied by both radii' and both frames' denominators: no division.
    const V s = hn::MulAdd(s1, cl, hn::Mul(c1, sl));
    const V c = hn::NegMulAdd(s1, sl, hn::Mul(c1, cl));
    const V hx = hn::Add(x5, g.hx);
    const V hy = hn::Add(x6, g.hy);
    const auto direction = [&](V sine, V cosine, V dx, V dy, V* out) HWY_ATTR {
      const V difference = hn::MulSub(dx, dx, hn::Mul(dy, dy));
      const V cross = hn::Mul(Set(2.0), hn::Mul(dx, dy));
      out[0] = hn::MulAdd(cosine, hn::Add(one, difference), hn::Mul(cross, sine));
      out[1] = hn::MulAdd(sine, hn::Sub(one, difference), hn::Mul(cross, cosine));
      out[2] = hn::Mul(Set(2.0), hn::MulSub(dx, sine, hn::Mul(dy, cosine)));
    };
    V own[3], reference[3];
    direction(s, c, hx, hy, own);
    direction(sl, cl, g.hx, g.hy, reference);
    const V own_scale = hn::Mul(a, hn::MulAdd(hx, hx, hn::MulAdd(hy, hy, one)));
    const V reference_scale = hn::Mul(q, hn::MulAdd(g.hx, g.hx, hn::MulAdd(g.hy, g.hy, one)));
    V distance2 = Set(0.0);
    for (int i = 0; i < 3; ++i) {
      const V d = hn::MulSub(own[i], reference_scale, hn::Mul(reference[i], own_scale));
      distance2 = hn::MulAdd(d, d, distance2);
    }
    const V scale = hn::Mul(own_scale, reference_scale);
    value.outside = hn::Gt(distance2, hn::Mul(hn::Load(kD, l.distance2 + at), hn::Mul(scale, scale)));
    return value;
  }

  // Books a sample for the lanes of `hit`, whose counter stands at it already.
  static HWY_INLINE void TakeSample(Lanes& l, std::size_t at, M hit) {
    const SampleValue value = ValueAtSample(l, at);
    const V sample = hn::Load(kD, l.sample + at);
    const V one = Set(1.0);
    const M at_end = hn::Ge(sample, hn::Load(kD, l.horizon + at));
    const V fuel = hn::Load(kD, l.fuel + at);
    const V new_fuel = hn::IfThenElse(hn::AndNot(at_end, hit), hn::Add(fuel, value.control), fuel);
    const M outside = hn::And(hit, value.outside);
    hn::Store(new_fuel, kD, l.fuel + at);
    // Outside at the end: not settled, and Hc = H.
    const V settled_at = hn::IfThenElse(at_end, sample, hn::Add(sample, one));
    hn::Store(hn::IfThenElse(outside, settled_at, hn::Load(kD, l.settling + at)), kD, l.settling + at);
    hn::Store(hn::IfThenElse(outside, new_fuel, hn::Load(kD, l.settling_fuel + at)), kD, l.settling_fuel + at);
    hn::Store(hn::IfThenElse(hit, hn::IfThenElseZero(value.outside, one), hn::Load(kD, l.outside + at)), kD,
              l.outside + at);
    const M first = hn::And(hit, hn::Eq(sample, Set(0.0)));
    hn::Store(hn::IfThenElse(first, value.lyapunov, hn::Load(kD, l.first_lyapunov + at)), kD, l.first_lyapunov + at);
    const M rest = hn::And(hit, hn::Or(at_end, hn::Le(value.lyapunov, hn::Load(kD, l.settled_below + at))));
    // A control that is no number ends the episode as a failure.
    const M broken = hn::And(hit, hn::Not(hn::Lt(value.control, Set(1e300))));
    V end = hn::Load(kD, l.end + at);
    end = hn::IfThenElse(rest, Set(kAtRest), end);
    end = hn::IfThenElse(broken, Set(kStuck), end);
    hn::Store(end, kD, l.end + at);
  }

  // As in core/sim/scalar_simulator.cc.
  static constexpr double kEdge = 1e-4;
  static constexpr double kNearEdge = 1e-2;

  // Decides each lane's attempt: accepts or rejects it, sets the next step size, books samples, notes ends.
  static HWY_INLINE void Decide(Lanes& l, const Row (*k)[kComponents], const Attempt& attempt, const V* y, V z,
                                V normal, std::size_t v) {
    const std::size_t at = v * kWidth;
    const auto load = [&](const Row& row) HWY_ATTR { return hn::Load(kD, row + at); };
    const auto store = [&](V value, Row& row) HWY_ATTR { hn::Store(value, kD, row + at); };
    const V one = Set(1.0);
    const V h = attempt.h[v];

    // A longitude error of whole turns is none: |sin x1| and 1 - cos x1 instead of |x1|.
    V size = hn::Max(load(l.size_floor), hn::Max(hn::Abs(y[kS1]), hn::Sub(one, y[kC1])));
    size = hn::Max(size, hn::Max(hn::Abs(load(l.y[kS1])), hn::Sub(one, load(l.y[kC1]))));
    for (std::size_t i = kX2; i <= kX6; ++i) size = hn::Max(size, hn::Max(hn::Abs(y[i]), hn::Abs(load(l.y[i]))));
    V squares = Set(0.0);
    V longitude_error = Set(0.0);
    for (std::size_t i = 0; i < kIntegrated; ++i) {
      V error = hn::Mul(Set(kE[0]), hn::Load(kD, k[0][i] + at));
      for (std::size_t j = 2; j < kStages; ++j) error = hn::MulAdd(Set(kE[j]), hn::Load(kD, k[j][i] + at), error);
      if (i == kL) {
        longitude_error = hn::Mul(error, size);
      } else {
        squares = hn::MulAdd(error, error, squares);
      }
    }
    squares = hn::MulAdd(longitude_error, longitude_error, squares);
    const V scale = hn::Div(h, hn::Mul(load(l.tolerance), size));
    const V error2 = hn::Mul(squares, hn::Mul(scale, scale));

    const M flying = hn::Eq(load(l.end), Set(kFlying));
    const M inside = hn::Gt(attempt.margin[v], Set(0.0));
    const M accurate = hn::Le(error2, one);
    const M accepted = hn::And(flying, hn::And(inside, accurate));

    // Step size: Gustafsson's PI controller, as the scalar simulator's, in powers of two.
    const V log_error = hn::Max(hn::Mul(Set(0.5), RoughLog2(hn::Max(error2, Set(1e-20)))), Set(-33.0));
    const V old_log = load(l.log_error);
    V growth = hn::Mul(Set(0.88), RoughExp2(hn::MulAdd(Set(0.04), old_log, hn::Mul(Set(-0.17), log_error))));
    growth = hn::Min(hn::Max(growth, Set(0.2)), load(l.grown));
    V shrink = hn::Max(hn::Mul(Set(0.88), RoughExp2(hn::Mul(Set(-0.2), hn::Min(log_error, Set(100.0))))), Set(0.2));
    shrink = hn::IfThenElse(hn::Lt(error2, Set(1e30)), shrink, Set(0.2));  // not a number, too
    shrink = hn::IfThenElse(inside, shrink, Set(0.25));
    const V step = load(l.step);
    const V grown = hn::Mul(h, growth);
    // A step cut short to meet a sample says little about the next one's size.
    const V accepted_step = hn::IfThenElse(hn::Lt(h, step), hn::Max(step, grown), grown);
    const V new_step = hn::IfThenElse(accepted, accepted_step, hn::Mul(h, shrink));
    // A lane that has ended must not shrink its step into the subnormal numbers.
    store(hn::IfThenElse(flying, new_step, step), l.step);
    store(hn::IfThenElse(accepted, hn::Max(log_error, Set(-13.0)), old_log), l.log_error);
    store(hn::IfThenElse(accepted, Set(5.0), one), l.grown);
    const V attempts = hn::Add(load(l.attempts), one);
    store(attempts, l.attempts);
    store(hn::IfThenElse(accepted, load(l.rejected), hn::Add(load(l.rejected), one)), l.rejected);

    const V time = load(l.time);
    const V new_time = hn::IfThenElse(attempt.last[v], attempt.next_sample_time[v], hn::Add(time, h));
    store(hn::IfThenElse(accepted, new_time, time), l.time);
    for (std::size_t i = 0; i < kComponents; ++i) {
      store(hn::IfThenElse(accepted, y[i], load(l.y[i])), l.y[i]);
      store(hn::IfThenElse(accepted, hn::Load(kD, k[kStages - 1][i] + at), load(l.rate[i])), l.rate[i]);
    }
    store(hn::IfThenElse(accepted, z, load(l.z)), l.z);
    store(hn::IfThenElse(accepted, normal, load(l.normal)), l.normal);

    const M at_edge = hn::And(accepted, hn::Lt(attempt.margin[v], Set(kEdge)));
    const M stuck = hn::And(flying, hn::Or(hn::Lt(new_step, hn::Mul(Set(1e-13), hn::Max(one, time))),
                                           hn::Gt(attempts, load(l.max_attempts))));
    const V a =
        hn::MulAdd(load(l.ex), load(l.y[kCL]), hn::MulAdd(load(l.ey), load(l.y[kSL]), hn::Add(one, load(l.y[kX3]))));
    const V margin = hn::Min(a, hn::Add(one, load(l.y[kX2])));
    V end = load(l.end);
    end = hn::IfThenElse(stuck, hn::IfThenElse(hn::Lt(margin, Set(kNearEdge)), Set(kAtEdge), Set(kStuck)), end);
    end = hn::IfThenElse(at_edge, Set(kAtEdge), end);
    store(end, l.end);
    const M hit = hn::And(accepted, hn::AndNot(hn::Or(at_edge, stuck), attempt.last[v]));
    if (!hn::AllFalse(kD, hit)) {
      store(hn::IfThenElse(hit, hn::Add(load(l.sample), one), load(l.sample)), l.sample);
      TakeSample(l, at, hit);
    }
  }

  // One attempt of a step in every lane.
  static HWY_INLINE void Step(Lanes& l) {
    alignas(64) Row k[kStages][kComponents];
    Attempt attempt;
    V y[kVectors][kComponents];
    V z[kVectors], normal[kVectors];
    for (std::size_t v = 0; v < kVectors; ++v) {
      const std::size_t at = v * kWidth;
      const V sample = hn::Load(kD, l.sample + at);
      attempt.next_sample_time[v] = hn::Mul(hn::Add(sample, Set(1.0)), hn::Load(kD, l.sampling_period + at));
      const V remaining = hn::Sub(attempt.next_sample_time[v], hn::Load(kD, l.time + at));
      const V step = hn::Load(kD, l.step + at);
      attempt.last[v] = hn::Ge(step, hn::Mul(remaining, Set(1 - 1e-10)));
      attempt.h[v] = hn::IfThenElse(attempt.last[v], remaining, hn::Min(step, hn::Mul(remaining, Set(0.5))));
      attempt.margin[v] = Set(1.0);
      for (std::size_t i = 0; i < kComponents; ++i) {
        hn::Store(hn::Load(kD, l.rate[i] + at), kD, k[0][i] + at);
      }
    }
    Stage<1>(l, k, attempt, y, z, normal);
    Stage<2>(l, k, attempt, y, z, normal);
    Stage<3>(l, k, attempt, y, z, normal);
    Stage<4>(l, k, attempt, y, z, normal);
    Stage<5>(l, k, attempt, y, z, normal);
    Stage<6>(l, k, attempt, y, z, normal);
    for (std::size_t v = 0; v < kVectors; ++v) Decide(l, k, attempt, y[v], z[v], normal[v], v);
  }

  // Evaluates the loop at the state the lanes stand at, and books sample 0 of the `fresh` ones. The others' values come
  // out as they were: they are a function of the state alone.
  static HWY_INLINE void Begin(Lanes& l, const Row& fresh) {
    for (std::size_t v = 0; v < kVectors; ++v) {
      const std::size_t at = v * kWidth;
      const M is_fresh = hn::Ne(hn::Load(kD, fresh + at), Set(0.0));
      if (hn::AllFalse(kD, is_fresh)) continue;
      V y[kComponents];
      for (std::size_t i = 0; i < kIntegrated; ++i) y[i] = hn::Load(kD, l.y[i] + at);
      Project(y);
      for (std::size_t i = kIntegrated; i < kComponents; ++i) hn::Store(y[i], kD, l.y[i] + at);
      const LoopValue value = ClosedLoop(LoadConstants(l, at), y, l.rate, at);
      hn::Store(value.z, kD, l.z + at);
      hn::Store(value.normal, kD, l.normal + at);
      TakeSample(l, at, is_fresh);
    }
  }

  // Puts an episode into a lane.
  static void Load(Lanes& l, std::size_t lane, const LaneEpisode& e, std::size_t index) {
    const auto set = [&](Row& row, double value) { row[lane] = value; };
    set(l.k1, e.k[0]);
    set(l.k2, e.k[1]);
    set(l.k3, e.k[2]);
    set(l.k4, e.k[3]);
    set(l.k5, e.k[4]);
    set(l.ex, e.ex);
    set(l.ey, e.ey);
    set(l.hx, e.hx);
    set(l.hy, e.hy);
    set(l.sampling_period, e.sampling_period);
    set(l.horizon, e.horizon_samples);
    set(l.distance2, e.settling_distance * e.settling_distance);
    set(l.settled_below, e.settled_below);
    set(l.control_scale, 1 / e.control_unit);
    set(l.tolerance, e.tolerance);
    set(l.size_floor, 1e-2 * e.settling_distance);
    set(l.max_attempts, e.max_attempts);
    for (std::size_t i = 0; i < 6; ++i) set(l.y[i], e.x[i]);
    set(l.y[kL], e.target_longitude);
    set(l.time, 0);
    set(l.step, e.sampling_period / 8);
    set(l.log_error, -13);
    set(l.grown, 5);
    for (Row* row : {&l.sample, &l.attempts, &l.rejected, &l.settling, &l.fuel, &l.settling_fuel, &l.end}) set(*row, 0);
    set(l.outside, 1);
    l.episode[lane] = index;
  }

  // A lane without an episode: a target orbit at rest with nothing to do, so that its arithmetic stays tame.
  static void LoadIdle(Lanes& l, std::size_t lane) {
    const LaneEpisode idle{.x = {0, 0, 0, 0, 0, 0},
                           .k = {1, 1, 1, 1, 1},
                           .sampling_period = 1,
                           .horizon_samples = 1,
                           .settling_distance = 1,
                           .settled_below = -1,
                           .control_unit = 1,
                           .tolerance = 1e-3,
                           .max_attempts = 1};
    Load(l, lane, idle, 0);
    l.end[lane] = kIdle;
  }

  static LaneResult Unload(const Lanes& l, std::size_t lane) {
    const double end = l.end[lane];
    LaneResult r{};
    r.outcome = end == kAtRest   ? (l.outside[lane] != 0 ? LaneOutcome::kNotSettled : LaneOutcome::kSettled)
                : end == kAtEdge ? LaneOutcome::kLeftDomain
                                 : LaneOutcome::kNumericalFailure;
    r.settling_samples = static_cast<int>(l.settling[lane]);
    r.fuel_sum = l.settling_fuel[lane];
    r.end_time = l.time[lane];
    r.initial_lyapunov = l.first_lyapunov[lane];
    r.momentum_ratio = 1 + l.y[kX2][lane];
    r.inverse_radius = l.y[kX3][lane] + 1 + l.ex[lane] * l.y[kCL][lane] + l.ey[lane] * l.y[kSL][lane];
    r.rejected_steps = static_cast<int>(l.rejected[lane]);
    r.steps = static_cast<int>(l.attempts[lane]) - r.rejected_steps;
    return r;
  }

  // True once a lane in flight has ended.
  static HWY_INLINE bool AnyEnded(const Lanes& l) {
    for (std::size_t at = 0; at < kLanes; at += kWidth) {
      const V end = hn::Load(kD, l.end + at);
      const M settled = hn::Or(hn::Eq(end, Set(kFlying)), hn::Eq(end, Set(kIdle)));
      if (!hn::AllTrue(kD, settled)) return true;
    }
    return false;
  }

  static void Run(const LaneEpisode* episodes, LaneResult* results, std::size_t n) {
    Lanes lanes;
    alignas(64) Row fresh;
    for (std::size_t lane = 0; lane < kLanes; ++lane) LoadIdle(lanes, lane);
    std::size_t next = 0;
    std::size_t flying = 0;
    while (true) {
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        fresh[lane] = 0;
        if (lanes.end[lane] == kFlying) continue;
        if (lanes.end[lane] != kIdle) {
          results[lanes.episode[lane]] = Unload(lanes, lane);
          lanes.end[lane] = kIdle;
          --flying;
        }
        if (next == n) continue;
        Load(lanes, lane, episodes[next], next);
        ++next;
        ++flying;
        fresh[lane] = 1;
      }
      if (flying == 0) return;
      Begin(lanes, fresh);
      do {
        Step(lanes);
      } while (!AnyEnded(lanes));
    }
  }
};

// Two vectors keep the arithmetic units busy; a last few episodes more are better flown beside them than after them.
constexpr std::size_t kUsualVectors = 2;

inline void Run(const LaneEpisode* episodes, LaneResult* results, std::size_t n) {
  if (n <= kWidth) return Kernel<1>::Run(episodes, results, n);
  if (n > kUsualVectors * kWidth && n <= (kUsualVectors + 1) * kWidth) {
    return Kernel<kUsualVectors + 1>::Run(episodes, results, n);
  }
  Kernel<kUsualVectors>::Run(episodes, results, n);
}

inline std::size_t Count() { return kUsualVectors * kWidth; }

}  // namespace orbitune::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
