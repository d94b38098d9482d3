// The kernel itself, compiled once for each instruction set (Highway's foreach_target). Every operation is written out,
// fused or not, so that all targets with a fused multiply-add give the same bits.
#if defined(ORBITUNE_CORE_SIMD_LANE_KERNEL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ORBITUNE_CORE_SIMD_LANE_KERNEL_INL_H_
#undef ORBITUNE_CORE_SIMD_LANE_KERNEL_INL_H_
#else
#define ORBITUNE_CORE_SIMD_LANE_KERNEL_INL_H_
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/simd/lane_kernel.h"
#include "core/simd/lane_math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace orbitune::simd::HWY_NAMESPACE {

constexpr std::size_t kWidth = hn::MaxLanes(D());

// What is integrated (docs/model.md, "The closed loop as it is computed"): the sine and cosine of x1 instead of x1,
// z = x4 - xi instead of x4, and the sine and cosine of the target's longitude L_r. No sine is computed on the way, and
// neither is the rate of xi.
enum Component : std::size_t { kS1, kC1, kX2, kX3, kZ, kX5, kX6, kSL, kCL, kComponents };

struct Kernel {
  using Row = double[kWidth];

  static HWY_INLINE V Load(const Row& row) { return hn::Load(kD, row); }
  static HWY_INLINE void Store(V value, Row& row) { hn::Store(value, kD, row); }

  // The episodes in flight, a row for each quantity, a column for each lane.
  struct alignas(64) Lanes {
    // Constant during an episode.
    Row k1, k2, k3, k4, minus_k5, ex, ey, hx, hy;
    Row sampling_period, horizon, distance2, settled_below, exit_below, control_scale, tolerance, floor2, max_attempts;
    Row doubt;  // twice kDoubt / ((1 - e_r)^2 epsilon); 0: a sample's side of epsilon is taken as it comes
    // At the newest accepted state.
    Row y[kComponents];
    Row rate[kComponents];                // the first stage of the next step
    Row size2;                            // |x|^2
    Row time, step, log_error, log_most;  // log_most: of what factor the next step may grow by: 0 after a rejection
    Row sample, attempts, rejected;
    // Bounds on the local errors: their sum since the newest sample, and that of those before, each over sqrt(V).
    Row error, drift;
    Row allowed;  // of error, for a unit of time
    // The cost so far.
    Row settling, fuel, settling_fuel, outside, first_lyapunov;
    Row flight;                   // from 0
    Row doubtful;                 // 1: a sample that may be the last outside, or inside after it, is too near epsilon
    Row end;                      // kFlying, ...
    std::size_t episode[kWidth];  // which one a lane flies
  };

  // How a lane's episode stands, as the numbers that a row holds.
  static constexpr double kFlying = 0, kAtRest = 1, kAtEdge = 2, kStuck = 3, kIdle = 4;

  struct Constants {
    V k1, k2, k3, k4, minus_k5, ex, ey, hx, hy;
  };

  static HWY_INLINE Constants LoadConstants(const Lanes& l) {
    return {Load(l.k1), Load(l.k2), Load(l.k3), Load(l.k4), Load(l.minus_k5),
            Load(l.ex), Load(l.ey), Load(l.hx), Load(l.hy)};
  }

  struct LoopValue {
    V margin;   // min(a, 1 + x2): positive in the domain
    V normal;   // u_h
    V a, q, n;  // 1 / r, 1 / r_r, and the rate of L_r
    V f12, f13, inv_f12;
    V slope;         // (d xi / d x1) / K1
    V s, c, hx, hy;  // the chaser's: sin L, cos L, and the inclination vector
    V h2;            // 1 + hx^2 + hy^2
    V half;          // |(H5, H6)|
  };

  // What depends on x2, x3 and L_r only.
  struct Geometry {
    V a, m;    // 1 / r, and 1 + x2
    V inv_am;  // the only division of a stage
  };

  static HWY_INLINE Geometry GeometryOf(const Constants& g, const V* HWY_RESTRICT y) {
    const V one = Set(1.0);
    const V m = hn::Add(one, y[kX2]);
    const V a = hn::Add(hn::MulAdd(g.ex, y[kCL], one), hn::MulAdd(g.ey, y[kSL], y[kX3]));
    return {a, m, hn::Div(one, hn::Mul(a, m))};
  }

  // The closed loop (core/control/control_law.cc) with u substituted: one division, no root, no sine. Gives dy/dt.
  // A processor looks ahead only so far, so the order is that of need: the rates of x2, x3 and L_r come first, and with
  // them `meanwhile` can begin the next stage's division.
  template <typename Meanwhile>
  static HWY_INLINE LoopValue ClosedLoop(const Constants& g, const V* HWY_RESTRICT y, const Geometry& geometry,
                                         V* HWY_RESTRICT rate, const Meanwhile& meanwhile) {
    const V s1 = y[kS1], c1 = y[kC1], x2 = y[kX2], x3 = y[kX3], z = y[kZ], x5 = y[kX5], x6 = y[kX6];
    const V sl = y[kSL], cl = y[kCL];
    const V a = geometry.a, m = geometry.m, inv_am = geometry.inv_am;
    const V one = Set(1.0);

    const V q = hn::MulAdd(g.ex, cl, hn::MulAdd(g.ey, sl, one));
    const V n = hn::Mul(q, q);
    const V f12 = hn::Mul(a, a);
    const V f13 = hn::Add(a, q);
    const V f42_f12 = hn::Mul(hn::Add(one, m), a);
    const V k1s1 = hn::Mul(g.k1, s1);
    rate[kX2] = hn::NegMulSub(f12, hn::MulAdd(f42_f12, z, k1s1), hn::Mul(g.k2, x2));
    rate[kX3] = hn::NegMulSub(f13, k1s1, hn::MulAdd(f12, z, hn::Mul(g.k3, x3)));
    rate[kSL] = hn::Mul(cl, n);
    rate[kCL] = hn::NegMulAdd(sl, n, hn::Zero(kD));

    const V s = hn::MulAdd(s1, cl, hn::Mul(c1, sl));
    const V c = hn::NegMulAdd(s1, sl, hn::Mul(c1, cl));
    const V hx = hn::Add(x5, g.hx);
    const V hy = hn::Add(x6, g.hy);
    const V h2 = hn::MulAdd(hx, hx, hn::MulAdd(hy, hy, one));
    const V half = hn::Mul(Set(0.5), h2);
    // H1, H5, H6, all times a m.
    const V h1 = hn::MulSub(hx, s, hn::Mul(hy, c));
    const V h5 = hn::Mul(half, c);
    const V h6 = hn::Mul(half, s);
    const V planar1 = hn::MulAdd(f12, x2, hn::Mul(f13, x3));
    const V planar4 = hn::MulSub(f12, hn::MulAdd(f42_f12, x2, x3), hn::Mul(g.k4, z));
    const V by_plane = hn::MulAdd(x5, h5, hn::Mul(x6, h6));
    const V slope = hn::Mul(hn::Mul(f13, c1), hn::Mul(m, m));  // (d xi / d x1) / K1, times (a m)^2
    const V k1_slope = hn::Mul(g.k1, slope);
    meanwhile();

    const V inv_am2 = hn::Mul(inv_am, inv_am);
    const V v_h = hn::MulAdd(h1, hn::NegMulAdd(hn::Mul(k1_slope, z), inv_am2, k1s1), by_plane);
    const V w = hn::Mul(hn::Mul(g.minus_k5, inv_am2), v_h);  // u_h / (a m)
    const V dx1 = hn::MulAdd(h1, w, planar1);
    rate[kX5] = hn::Mul(h5, w);
    rate[kX6] = hn::Mul(h6, w);
    rate[kZ] = hn::NegMulAdd(hn::Mul(hn::Mul(h1, k1_slope), inv_am2), w, planar4);
    rate[kS1] = hn::Mul(c1, dx1);
    rate[kC1] = hn::NegMulAdd(s1, dx1, hn::Zero(kD));
    return {hn::Min(a, m),
            hn::Mul(w, hn::Mul(a, m)),
            a,
            q,
            n,
            f12,
            f13,
            hn::Mul(inv_am2, hn::Mul(m, m)),
            hn::Mul(slope, inv_am2),
            s,
            c,
            hx,
            hy,
            h2,
            hn::Mul(half, inv_am)};
  }

  // xi = (K1 f13 sin x1 + (K3 - f33) x3) / f12, with f33 = f13 zeta_Y.
  struct Xi {
    V zeta_y, damping;  // K3 - f33
    V xi;
  };

  static HWY_INLINE Xi XiOf(const Constants& g, const V* HWY_RESTRICT y, V f13, V inv_f12) {
    Xi value;
    value.zeta_y = hn::MulSub(g.ex, y[kSL], hn::Mul(g.ey, y[kCL]));
    value.damping = hn::NegMulAdd(f13, value.zeta_y, g.k3);
    value.xi = hn::Mul(hn::MulAdd(f13, hn::Mul(g.k1, y[kS1]), hn::Mul(value.damping, y[kX3])), inv_f12);
    return value;
  }

  // |x|^2; an error of x1 by whole turns is none: |2 sin(x1 / 2)| instead of |x1|.
  static HWY_INLINE V SquaredSize(const V* y, V x4) {
    V sum = hn::MulAdd(x4, x4, hn::Mul(Set(2.0), hn::Sub(Set(1.0), y[kC1])));
    for (const std::size_t i : {kX2, kX3, kX5, kX6}) sum = hn::MulAdd(y[i], y[i], sum);
    return sum;
  }

  // Back to the unit circle, which a step leaves by its error e, to e^2: one Newton step for 1 / sqrt. Before the last
  // stage, not after it: that is the next step's first, and rates that do not belong to its state cost a digit.
  static HWY_INLINE void Normalise(V& sine, V& cosine) {
    const V square = hn::MulAdd(sine, sine, hn::Mul(cosine, cosine));
    const V factor = hn::NegMulAdd(Set(0.5), square, Set(1.5));
    sine = hn::Mul(sine, factor);
    cosine = hn::Mul(cosine, factor);
  }

  // Ch. Tsitouras, "Runge-Kutta pairs of order 5(4) satisfying only the first column simplifying assumption",
  // Comput. Math. Appl. 62 (2011), 770-775, table 1: seven stages, the last of which is the next step's first.
  static constexpr std::size_t kStages = 7;
  static constexpr double kA[kStages][kStages - 1] = {
      {},
      {0.161},
      {-0.00848065549235698854443, 0.335480655492356988544},
      {2.89715305710549343213, -6.35944848997507484315, 4.36229543286958141102},
      {5.32586482843925660443, -11.7488835640628278777, 7.49553934288983620830, -0.0924950663617552492565},
      {5.86145544294642002866, -12.9209693178471092917, 8.15936789857615864318, -0.0715849732814009972245,
       -0.0282690503940683829090},
      {0.0964607668180652295182, 0.01, 0.479889650414499574775, 1.37900857410374189319, -3.29006951543608067990,
       2.32471052409977398242},
  };
  static constexpr double kE[kStages] = {
      0.00178001105222577144338, 0.000816434459656746903224, -0.00788087801026199601031, 0.144711007173262907537,
      -0.582357165452555225020,  0.458082105929186946662,    -0.0151515151515151515152};

  // What one attempt of a step needs beside the lanes.
  struct Attempt {
    V h, next_sample_time;
    M last;
    V margin;
    LoopValue end;
    Geometry geometry;
    V y[kComponents];      // where the stage's rates are wanted
    V error[kComponents];  // over h
  };

  // Whose rates do not need the stage's division.
  static constexpr bool kKnownEarly[kComponents] = {false, false, true, true, false, false, false, true, true};

  // The rates of a stage, and from them where the next one is, or the error.
  template <std::size_t kStage>
  static HWY_INLINE void Stage(const Lanes& l, Row (*k)[kComponents], Attempt& attempt) {
    constexpr bool kLast = kStage == kStages - 1;
    V rate[kComponents];
    V next[kComponents];
    V* y = attempt.y;
    const Constants g = LoadConstants(l);
    const auto weight = [&](std::size_t j) HWY_ATTR {
      return kLast ? Set(kE[j]) : hn::Mul(attempt.h, Set(kA[kLast ? 0 : kStage + 1][j]));
    };
    const auto sum = [&](bool early) HWY_ATTR {
      for (std::size_t j = 0; j < kStage; ++j) {
        const V w = weight(j);
        for (std::size_t i = 0; i < kComponents; ++i) {
          if (kKnownEarly[i] != early) continue;
          const V rate_j = Load(j == 0 ? l.rate[i] : k[j][i]);
          next[i] = kLast && j == 0 ? hn::Mul(w, rate_j) : hn::MulAdd(w, rate_j, j == 0 ? Load(l.y[i]) : next[i]);
        }
      }
    };
    const auto finish = [&](bool early) HWY_ATTR {
      const V w = weight(kStage);
      for (std::size_t i = 0; i < kComponents; ++i) {
        if (kKnownEarly[i] != early) continue;
        next[i] = hn::MulAdd(w, rate[i], next[i]);
        Store(rate[i], k[kStage][i]);
      }
    };
    const Geometry geometry = attempt.geometry;
    attempt.end = ClosedLoop(g, y, geometry, rate, [&]() HWY_ATTR {
      sum(true);
      finish(true);
      if (kStage == kStages - 2) Normalise(next[kSL], next[kCL]);
      if (!kLast) attempt.geometry = GeometryOf(g, next);
      sum(false);
    });
    attempt.margin = hn::Min(attempt.margin, attempt.end.margin);
    finish(false);
    if (kStage == kStages - 2) Normalise(next[kS1], next[kC1]);
    for (std::size_t i = 0; i < kComponents; ++i) (kLast ? attempt.error : y)[i] = next[i];
  }

  // V(x), ||u|| in the cost's unit, and the squared distance and epsilon^2, of the accepted state.
  struct SampleValue {
    V lyapunov, control;
    V distance2, epsilon2;  // in a common unit of the sample's own
  };

  static HWY_INLINE SampleValue ValueAtSample(const Lanes& l, const Constants& g, const V* HWY_RESTRICT y,
                                              const Row* HWY_RESTRICT rate, const LoopValue& loop, const Xi& xi) {
    const V one = Set(1.0);
    const V x2 = y[kX2], x3 = y[kX3], z = y[kZ], x5 = y[kX5], x6 = y[kX6];
    const V s1 = y[kS1], c1 = y[kC1], sl = y[kSL], cl = y[kCL];
    const V squares = hn::MulAdd(x2, x2, hn::MulAdd(x3, x3, hn::MulAdd(z, z, hn::MulAdd(x5, x5, hn::Mul(x6, x6)))));
    SampleValue value;
    value.lyapunov = hn::MulAdd(g.k1, hn::Sub(one, c1), hn::Mul(Set(0.5), squares));

    // x2' = u_theta / a; u_r cancels what is left of x4' = f42 x2 + f12 x3 - K4 z + xi', where xi' is planar.
    const V f13 = loop.f13;
    const V zeta_x = hn::Sub(loop.q, one);
    const V x1_rate = hn::MulAdd(loop.f12, x2, hn::Mul(f13, x3));
    const V x3_rate = Load(rate[kX3]);
    const V half_f12_rate = hn::NegMulAdd(xi.zeta_y, loop.n, x3_rate);  // over a; zeta_X' = -zeta_Y n
    const V f13_rate = hn::NegMulAdd(xi.zeta_y, loop.n, half_f12_rate);
    const V f33_rate = hn::MulAdd(f13_rate, xi.zeta_y, hn::Mul(f13, hn::Mul(zeta_x, loop.n)));
    const V f12_rate = hn::Mul(hn::Add(loop.a, loop.a), half_f12_rate);
    const V n_rate = hn::MulAdd(g.k1, hn::MulAdd(f13_rate, s1, hn::Mul(hn::Mul(f13, c1), x1_rate)),
                                hn::NegMulAdd(f33_rate, x3, hn::Mul(xi.damping, x3_rate)));
    const V xi_rate = hn::Mul(hn::NegMulAdd(xi.xi, f12_rate, n_rate), loop.inv_f12);
    const V radial = hn::NegMulAdd(hn::Mul(f13, zeta_x), x3, hn::NegMulAdd(g.k4, z, xi_rate));
    const V transverse = hn::Mul(loop.a, Load(rate[kX2]));
    const V normal = loop.normal;
    const V norm2 = hn::MulAdd(radial, radial, hn::MulAdd(transverse, transverse, hn::Mul(normal, normal)));
    value.control = hn::Mul(hn::Sqrt(norm2), Load(l.control_scale));

    // y <= epsilon, multiplied by both radii' and both frames' denominators: no division.
    const auto direction = [&](V sine, V cosine, V dx, V dy, V* out) HWY_ATTR {
      const V difference = hn::MulSub(dx, dx, hn::Mul(dy, dy));
      const V cross = hn::Mul(hn::Add(dx, dx), dy);
      out[0] = hn::MulAdd(cosine, hn::Add(one, difference), hn::Mul(cross, sine));
      out[1] = hn::MulAdd(sine, hn::Sub(one, difference), hn::Mul(cross, cosine));
      out[2] = hn::Mul(Set(2.0), hn::MulSub(dx, sine, hn::Mul(dy, cosine)));
    };
    V own[3], reference[3];
    direction(loop.s, loop.c, loop.hx, loop.hy, own);
    direction(sl, cl, g.hx, g.hy, reference);
    const V own_scale = hn::Mul(loop.a, loop.h2);
    const V reference_scale = hn::Mul(loop.q, hn::MulAdd(g.hx, g.hx, hn::MulAdd(g.hy, g.hy, one)));
    V distance2 = Set(0.0);
    for (int i = 0; i < 3; ++i) {
      const V d = hn::MulSub(own[i], reference_scale, hn::Mul(reference[i], own_scale));
      distance2 = hn::MulAdd(d, d, distance2);
    }
    const V scale = hn::Mul(own_scale, reference_scale);
    value.distance2 = distance2;
    value.epsilon2 = hn::Mul(Load(l.distance2), hn::Mul(scale, scale));
    return value;
  }

  // An episode's first flight measures its errors against the size of the state, but not less than 30 settling
  // distances: smaller ones do nothing to the cost, but they may put a sample on the wrong side of epsilon. Where that
  // is in doubt the episode is flown again, with smaller errors at small distances, and where that does not settle it
  // once more with much smaller ones everywhere (docs/model.md, "Integration").
  static constexpr std::size_t kFlights = 3;
  static constexpr double kFlightTolerance[kFlights] = {1, 0.5, 0.01};  // of the tolerance
  static constexpr double kFlightFloor[kFlights] = {30, 1, 0.01};       // settling distances
  static constexpr double kLargestFloor = 0.03;
  // The part of the bound on errors that counts, by experience: at the default tolerance, of 17,000 episodes, random
  // ones and near tuned gains, they were 0.13 of the bound at most.
  static constexpr double kDoubt = 0.4;

  // The slower an episode decays the more often it makes the same error, and the longer it keeps it. So the tolerance
  // goes with the square of the halvings of sqrt(V) in a sampling period so far, and is meant for kUsualRate of them.
  // Before an episode has shown its rate it is taken to have the usual one: kPrior halvings in kPriorSamples periods.
  // The last flight, whose samples count as they come, is given no more than what was asked for.
  static constexpr double kPrior = 0.5, kPriorSamples = 10, kUsualRate = kPrior / kPriorSamples,
                          kLogMostPatience = 2.64, kLogLeastPatience = -4;

  static HWY_INLINE V Patience(const Lanes& l, V sample, V log_root) {
    const V first_log_root = hn::Mul(Set(0.5), RoughLog2(hn::Max(Load(l.first_lyapunov), Set(1e-300))));
    const V halvings = hn::Add(hn::Max(hn::Sub(first_log_root, log_root), Set(0.0)), Set(kPrior));
    const V periods = hn::MulAdd(sample, Set(kUsualRate), Set(kUsualRate * kPriorSamples));
    const V log_square = hn::Mul(Set(2 * kLogScale), hn::Sub(LogBits(halvings), LogBits(periods)));
    const V most = hn::IfThenElse(hn::Eq(Load(l.flight), Set(kFlights - 1)), Set(0.0), Set(kLogMostPatience));
    return RoughExp2(hn::Max(hn::Min(log_square, most), Set(kLogLeastPatience)));
  }

  // Books a sample for the lanes of `hit`, whose counter stands at it already.
  static HWY_INLINE void TakeSample(Lanes& l, M hit, const SampleValue& value) {
    const V sample = Load(l.sample);
    const V one = Set(1.0);
    const M at_end = hn::Ge(sample, Load(l.horizon));
    const V fuel = Load(l.fuel);
    const V new_fuel = hn::IfThenElse(hn::AndNot(at_end, hit), hn::Add(fuel, value.control), fuel);
    const M is_outside = hn::Gt(value.distance2, value.epsilon2);
    const M outside = hn::And(hit, is_outside);
    Store(new_fuel, l.fuel);
    // Outside at the end: not settled, and Hc = H.
    const V settled_at = hn::IfThenElse(at_end, sample, hn::Add(sample, one));
    Store(hn::IfThenElse(outside, settled_at, Load(l.settling)), l.settling);
    Store(hn::IfThenElse(outside, new_fuel, Load(l.settling_fuel)), l.settling_fuel);
    Store(hn::IfThenElse(hit, hn::IfThenElseZero(is_outside, one), Load(l.outside)), l.outside);
    const M first = hn::And(hit, hn::Eq(sample, Set(0.0)));
    Store(hn::IfThenElse(first, value.lyapunov, Load(l.first_lyapunov)), l.first_lyapunov);

    // Errors decay as the state does, with sqrt(V); its power of two will do.
    const V log_root = hn::Mul(Set(0.5), RoughLog2(hn::Max(value.lyapunov, Set(1e-300))));
    Store(hn::IfThenElse(hit, hn::Mul(Load(l.tolerance), Patience(l, sample, log_root)), Load(l.allowed)), l.allowed);
    const V drift = hn::MulAdd(Load(l.error), RoughExp2(hn::Neg(log_root)), Load(l.drift));
    Store(hn::IfThenElse(hit, drift, Load(l.drift)), l.drift);
    Store(hn::IfThenElse(hit, Set(0.0), Load(l.error)), l.error);
    const V doubt = hn::Mul(Load(l.doubt), hn::Mul(drift, RoughExp2(log_root)));
    const M near = hn::Lt(hn::Abs(hn::Sub(value.distance2, value.epsilon2)), hn::Mul(value.epsilon2, doubt));
    const V clear = hn::IfThenElse(outside, Set(0.0), Load(l.doubtful));
    Store(hn::IfThenElse(hn::And(hit, near), one, clear), l.doubtful);

    const V more = hn::MulAdd(Set(kDoubt), drift, one);
    const V bound = hn::Mul(value.lyapunov, hn::Mul(more, more));
    const M proven = hn::And(hit, hn::Le(bound, Load(l.settled_below)));
    Store(hn::IfThenElse(proven, Set(0.0), Load(l.doubt)), l.doubt);
    const M rest = hn::And(hit, hn::Or(at_end, hn::Le(bound, Load(l.exit_below))));
    // A control that is no number ends the episode as a failure.
    const M broken = hn::And(hit, hn::Not(hn::Lt(value.control, Set(1e300))));
    V end = Load(l.end);
    end = hn::IfThenElse(rest, Set(kAtRest), end);
    end = hn::IfThenElse(broken, Set(kStuck), end);
    Store(end, l.end);
  }

  // As in core/sim/scalar_simulator.cc.
  static constexpr double kEdge = 1e-4;
  static constexpr double kNearEdge = 1e-2;
  // The least local error, relative to the state, that a step is asked for: roundoff is not far.
  static constexpr double kRoundoff = 1e-13;

  // The squared error of an attempt, over h^2, of x (with x4's, in which a gain K3 shows) and, times |x|, of L_r.
  // Where the loop is stiff, h K > 1, a component's error counts (h K)^2 times: the control, which is what the cost is
  // made of, holds it K times.
  static HWY_INLINE V SquaredError(const Constants& g, const V* HWY_RESTRICT e, const LoopValue& loop, V h, V size2) {
    const auto stiffness = [&](V gain) HWY_ATTR {
      const V rate = hn::Mul(h, gain);
      return hn::Max(Set(1.0), hn::Mul(rate, rate));
    };
    const V weight4 = stiffness(hn::Max(g.k3, g.k4));
    const V weight56 = stiffness(hn::Mul(g.minus_k5, hn::Mul(loop.half, loop.half)));
    const V weighted2 = hn::Mul(e[kX2], stiffness(g.k2));
    V sum = hn::MulAdd(weighted2, weighted2, hn::Mul(e[kX3], e[kX3]));
    sum = hn::MulAdd(size2, hn::MulAdd(e[kSL], e[kSL], hn::Mul(e[kCL], e[kCL])), sum);
    const V sum56 = hn::MulAdd(e[kX5], e[kX5], hn::Mul(e[kX6], e[kX6]));
    sum = hn::MulAdd(hn::Mul(weight56, weight56), sum56, sum);
    const V x4 = hn::MulAdd(hn::Mul(loop.inv_f12, g.k3), e[kX3], hn::MulAdd(hn::Mul(g.k1, loop.slope), e[kS1], e[kZ]));
    const V weighted4 = hn::Mul(x4, weight4);
    sum = hn::MulAdd(e[kS1], e[kS1], hn::MulAdd(e[kC1], e[kC1], sum));
    return hn::MulAdd(weighted4, weighted4, sum);
  }

  // The step controller's factors 0.2, 0.25, 0.88 and 5 as RoughExp2's arguments. The third, which a rejected step
  // shrinks by at least, must be below the 0.9 of Step().
  static constexpr double kLogLeast = -2.4, kLogOutside = -2.0, kLogSafety = -0.24, kLogMost = 2.25;

  // Decides each lane's attempt: accepts or rejects it, sets the next step size, books samples, notes ends.
  static HWY_INLINE void Decide(Lanes& l, const Row (*k)[kComponents], Attempt& attempt) {
    const auto load = [&](const Row& row) HWY_ATTR { return Load(row); };
    const auto store = [&](V value, Row& row) HWY_ATTR { Store(value, row); };
    const V one = Set(1.0);
    const V h = attempt.h;
    V* y = attempt.y;
    const LoopValue& loop = attempt.end;
    const Constants g = LoadConstants(l);

    const V tolerated = hn::Max(hn::Mul(load(l.allowed), h), Set(kRoundoff));
    const V size2 =
        hn::Min(hn::Max(load(l.floor2), load(l.size2)), Set(1e300));  // an infinite error is within no bound
    const V bound2 = hn::Mul(size2, hn::Mul(tolerated, tolerated));
    const V log_bound2 = RoughLog2(bound2);
    const V minus_log_bound2 = hn::Sub(Set(kLogOffset), log_bound2);
    const M flying = hn::Eq(load(l.end), Set(kFlying));
    const M inside = hn::Gt(attempt.margin, Set(0.0));
    const M may_be = hn::And(flying, inside);
    const V step = load(l.step);
    const M cut_short = hn::Lt(h, step);
    const V old_log = load(l.log_error);
    const V by_history = hn::MulAdd(Set(0.04), old_log, Set(kLogSafety));
    const V error2 =
        hn::Mul(SquaredError(g, attempt.error, loop, h, hn::Max(load(l.size2), hn::Mul(Set(1e-6), load(l.floor2)))),
                hn::Mul(h, h));
    const M accurate = hn::Le(error2, bound2);
    const M accepted = hn::And(may_be, accurate);

    // Step size: Gustafsson's PI controller, as the scalar simulator's, in powers of two. After a step cut short to
    // meet a sample, and after a rejection, the error alone says how long it might have been. An error that is not a
    // number counts as an infinite one.
    const V log_square = hn::Max(hn::MulAdd(LogBits(error2), Set(kLogScale), minus_log_bound2), Set(-66.0));
    V log_growth = hn::IfThenElse(hn::AndNot(cut_short, accepted), hn::MulAdd(Set(-0.105), log_square, by_history),
                                  hn::MulAdd(Set(-0.125), log_square, Set(kLogSafety)));
    log_growth = hn::Min(hn::Max(log_growth, Set(kLogLeast)), load(l.log_most));
    log_growth = hn::IfThenElse(inside, log_growth, Set(kLogOutside));
    V new_step = hn::Mul(h, RoughExp2(log_growth));
    new_step = hn::IfThenElse(hn::And(accepted, cut_short), hn::Max(step, new_step), new_step);
    // A lane that has ended must not shrink its step into the subnormal numbers.
    store(hn::IfThenElse(flying, new_step, step), l.step);
    for (std::size_t i = 0; i < kComponents; ++i) {
      store(hn::IfThenElse(accepted, Load(k[kStages - 1][i]), load(l.rate[i])), l.rate[i]);
    }
    for (std::size_t i = 0; i < kComponents; ++i) store(hn::IfThenElse(accepted, y[i], load(l.y[i])), l.y[i]);
    const V time = load(l.time);
    const V new_time = hn::IfThenElse(attempt.last, attempt.next_sample_time, hn::Add(time, h));
    store(hn::IfThenElse(accepted, new_time, time), l.time);
    store(hn::IfThenElse(accepted, hn::Max(hn::Mul(Set(0.5), log_square), Set(-13.0)), old_log), l.log_error);
    store(hn::IfThenElse(accepted, Set(kLogMost), hn::Zero(kD)), l.log_most);
    const V attempts = hn::Add(load(l.attempts), one);
    store(attempts, l.attempts);
    store(hn::IfThenElse(accepted, load(l.rejected), hn::Add(load(l.rejected), one)), l.rejected);
    const Xi xi = XiOf(g, y, loop.f13, loop.inv_f12);
    const V new_size2 = SquaredSize(y, hn::Add(y[kZ], xi.xi));
    store(hn::IfThenElse(accepted, new_size2, load(l.size2)), l.size2);
    const V bound = RoughExp2(hn::Mul(Set(0.5), log_bound2));
    store(hn::IfThenElse(accepted, hn::Add(load(l.error), bound), load(l.error)), l.error);

    const M at_edge = hn::And(accepted, hn::Lt(attempt.margin, Set(kEdge)));
    const M stuck = hn::And(flying, hn::Or(hn::Lt(new_step, hn::Mul(Set(1e-13), hn::Max(one, time))),
                                           hn::Gt(attempts, load(l.max_attempts))));
    const M ended = hn::Or(at_edge, stuck);
    if (!hn::AllFalse(kD, ended)) {
      const V a = hn::MulAdd(g.ex, load(l.y[kCL]), hn::MulAdd(g.ey, load(l.y[kSL]), hn::Add(one, load(l.y[kX3]))));
      const M near_edge = hn::Lt(hn::Min(a, hn::Add(one, load(l.y[kX2]))), Set(kNearEdge));
      const V how = hn::IfThenElse(hn::Or(at_edge, near_edge), Set(kAtEdge), Set(kStuck));
      store(hn::IfThenElse(ended, how, load(l.end)), l.end);
    }
    const M hit = hn::And(accepted, hn::AndNot(ended, attempt.last));
    if (!hn::AllFalse(kD, hit)) {
      store(hn::IfThenElse(hit, hn::Add(load(l.sample), one), load(l.sample)), l.sample);
      TakeSample(l, hit, ValueAtSample(l, g, y, k[kStages - 1], loop, xi));
    }
  }

  // One attempt of a step in every lane.
  static HWY_INLINE void Step(Lanes& l) {
    alignas(64) Row k[kStages][kComponents];
    Attempt attempt;
    const V sample = Load(l.sample);
    attempt.next_sample_time = hn::Mul(hn::Add(sample, Set(1.0)), Load(l.sampling_period));
    const V remaining = hn::Sub(attempt.next_sample_time, Load(l.time));
    const V step = Load(l.step);
    // One step to the sample, or two, may be a little longer than asked for: that is what the safety factor is for.
    const V half = hn::Mul(remaining, Set(0.5));
    attempt.last = hn::Ge(step, hn::Mul(Set(0.9), remaining));
    attempt.h = hn::IfThenElse(hn::Ge(step, hn::Mul(Set(0.45), remaining)),
                               hn::IfThenElse(attempt.last, remaining, half), step);
    attempt.margin = Set(1.0);
    for (std::size_t i = 0; i < kComponents; ++i) {
      attempt.y[i] = hn::MulAdd(hn::Mul(attempt.h, Set(kA[1][0])), Load(l.rate[i]), Load(l.y[i]));
    }
    attempt.geometry = GeometryOf(LoadConstants(l), attempt.y);
    Stage<1>(l, k, attempt);
    Stage<2>(l, k, attempt);
    Stage<3>(l, k, attempt);
    Stage<4>(l, k, attempt);
    Stage<5>(l, k, attempt);
    Stage<6>(l, k, attempt);
    Decide(l, k, attempt);
  }

  // Evaluates the loop where the `fresh` lanes begin, and books their sample 0. Their rows hold x1, x4 and L_r in the
  // places of sin x1, z and sin L_r until then.
  static HWY_INLINE void Begin(Lanes& l, const Row& fresh) {
    const M is_fresh = hn::Ne(Load(fresh), Set(0.0));
    if (hn::AllFalse(kD, is_fresh)) return;
    const auto keep = [&](V value, Row& row) HWY_ATTR { Store(hn::IfThenElse(is_fresh, value, Load(row)), row); };
    V y[kComponents];
    for (std::size_t i = 0; i < kComponents; ++i) y[i] = Load(l.y[i]);
    const SinCos first = SinCosOf(y[kS1]);
    const SinCos target = SinCosOf(y[kSL]);
    y[kS1] = first.sin;
    y[kC1] = first.cos;
    y[kSL] = target.sin;
    y[kCL] = target.cos;
    const V x4 = std::exchange(y[kZ], Set(0.0));
    const Constants g = LoadConstants(l);
    V rates[kComponents];
    const auto nothing = []() HWY_ATTR {};
    const LoopValue planar = ClosedLoop(g, y, GeometryOf(g, y), rates, nothing);  // xi does not depend on z
    const Xi xi = XiOf(g, y, planar.f13, planar.inv_f12);
    y[kZ] = hn::Sub(x4, xi.xi);
    const LoopValue loop = ClosedLoop(g, y, GeometryOf(g, y), rates, nothing);
    alignas(64) Row rate[kComponents];
    for (std::size_t i = 0; i < kComponents; ++i) {
      Store(rates[i], rate[i]);
      keep(y[i], l.y[i]);
      keep(Load(rate[i]), l.rate[i]);
    }
    keep(SquaredSize(y, x4), l.size2);
    TakeSample(l, is_fresh, ValueAtSample(l, g, y, rate, loop, xi));
  }

  // Puts an episode into a lane.
  static void Load(Lanes& l, std::size_t lane, const LaneEpisode& e, std::size_t index, std::size_t flight) {
    const auto set = [&](Row& row, double value) { row[lane] = value; };
    set(l.k1, e.k[0]);
    set(l.k2, e.k[1]);
    set(l.k3, e.k[2]);
    set(l.k4, e.k[3]);
    set(l.minus_k5, -e.k[4]);
    set(l.ex, e.ex);
    set(l.ey, e.ey);
    set(l.hx, e.hx);
    set(l.hy, e.hy);
    set(l.sampling_period, e.sampling_period);
    set(l.horizon, e.horizon_samples);
    set(l.distance2, e.settling_distance * e.settling_distance);
    set(l.settled_below, e.settled_below);
    set(l.exit_below, e.early_exit ? e.settled_below : -1);
    set(l.control_scale, 1 / e.control_unit);
    set(l.flight, static_cast<double>(flight));
    set(l.tolerance, kFlightTolerance[flight] * e.tolerance / e.sampling_period);
    const double floor = std::min(kFlightFloor[flight] * e.settling_distance, kLargestFloor);
    set(l.floor2, floor * floor);
    const double q = 1 - std::sqrt(e.ex * e.ex + e.ey * e.ey);
    set(l.doubt, flight == kFlights - 1 ? 0 : 2 * kDoubt / (q * q * e.settling_distance));
    set(l.max_attempts, e.max_attempts);
    set(l.y[kS1], e.x[0]);
    set(l.y[kX2], e.x[1]);
    set(l.y[kX3], e.x[2]);
    set(l.y[kZ], e.x[3]);
    set(l.y[kX5], e.x[4]);
    set(l.y[kX6], e.x[5]);
    set(l.y[kSL], e.target_longitude);
    set(l.time, 0);
    set(l.step, e.sampling_period / 8);
    set(l.log_error, -13);
    set(l.log_most, kLogMost);
    for (Row* row : {&l.sample, &l.attempts, &l.rejected, &l.error, &l.drift, &l.settling, &l.fuel, &l.settling_fuel,
                     &l.doubtful, &l.end}) {
      set(*row, 0);
    }
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
    Load(l, lane, idle, 0, kFlights - 1);
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
    const V end = Load(l.end);
    return !hn::AllFalse(kD, hn::Not(hn::Or(hn::Eq(end, Set(kFlying)), hn::Eq(end, Set(kIdle)))));
  }

  // False: that is long enough to look whether anybody waits for the results.
  static HWY_INLINE bool StepUntilEnd(Lanes& l, LaneUse& use) {
    constexpr int kStepsAtOnce = 4096;  // some milliseconds
    for (int step = 1; step <= kStepsAtOnce; ++step) {
      Step(l);
      if (!AnyEnded(l)) continue;
      use.lane_steps += step * static_cast<std::int64_t>(kWidth);
      return true;
    }
    use.lane_steps += kStepsAtOnce * static_cast<std::int64_t>(kWidth);
    return false;
  }

  static LaneUse Run(const LaneEpisode* episodes, LaneResult* results, std::size_t n, const Interrupt& interrupt) {
    LaneUse use;
    Lanes lanes{};
    alignas(64) Row fresh;
    for (std::size_t lane = 0; lane < kWidth; ++lane) LoadIdle(lanes, lane);
    std::size_t next = 0;
    std::size_t flying = 0;
    while (true) {
      for (std::size_t lane = 0; lane < kWidth; ++lane) {
        fresh[lane] = 0;
        if (lanes.end[lane] == kFlying) continue;
        if (lanes.end[lane] != kIdle) {
          const std::size_t index = lanes.episode[lane];
          use.used_lane_steps += static_cast<std::int64_t>(lanes.attempts[lane]);
          if (lanes.end[lane] == kAtRest && lanes.doubtful[lane] != 0) {
            results[index] = Unload(lanes, lane);
            Load(lanes, lane, episodes[index], index, static_cast<std::size_t>(lanes.flight[lane]) + 1);
            fresh[lane] = 1;
            continue;
          }
          // A later flight that takes too many steps leaves what the one before had.
          if (lanes.end[lane] != kStuck || lanes.flight[lane] == 0) results[index] = Unload(lanes, lane);
          lanes.end[lane] = kIdle;
          --flying;
        }
        if (next == n) continue;
        Load(lanes, lane, episodes[next], next, 0);
        ++next;
        ++flying;
        fresh[lane] = 1;
      }
      if (flying == 0) return use;
      Begin(lanes, fresh);
      while (!StepUntilEnd(lanes, use)) {
        if (interrupt.asked == nullptr || !interrupt.asked(interrupt.context)) continue;
        use.interrupted = true;
        return use;
      }
    }
  }
};

inline LaneUse Run(const LaneEpisode* episodes, LaneResult* results, std::size_t n, const Interrupt& interrupt) {
  return Kernel::Run(episodes, results, n, interrupt);
}

inline std::size_t Count() { return kWidth; }

inline bool Fuses() { return HWY_NATIVE_FMA != 0; }

}  // namespace orbitune::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
