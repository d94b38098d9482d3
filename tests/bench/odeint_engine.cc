#include "tests/bench/odeint_engine.h"

#include <array>
#include <boost/numeric/odeint.hpp>
#include <cmath>

namespace orbitune::bench {
namespace {

using State = std::array<double, 7>;  // x1..x6, L_r

struct Loop {
  const TargetOrbit& target;
  const CanonicalGains& g;
  double control_norm = 0;  // of the newest evaluation

  void operator()(const State& y, State& d, double) {
    const double s1 = std::sin(y[0]), c1 = std::cos(y[0]), sl = std::sin(y[6]), cl = std::cos(y[6]);
    const double x2 = y[1], x3 = y[2], x4 = y[3], x5 = y[4], x6 = y[5];
    const double zx = target.ex * cl + target.ey * sl, zy = target.ex * sl - target.ey * cl;
    const double q = 1 + zx, n = q * q, a = x3 + q, m = 1 + x2;
    const double inv_am = 1 / (a * m), inv_f12 = inv_am * m * (inv_am * m);
    const double f12 = a * a, f13 = a + q, f33 = f13 * zy, f42 = (1 + m) * f12 * a;
    const double damping = g.k3 - f33;
    const double xi = (g.k1 * f13 * s1 + damping * x3) * inv_f12;
    const double rate1 = f12 * x2 + f13 * x3, rate3 = -f33 * x3 - f12 * x4;
    const double zx_rate = -zy * n, zy_rate = zx * n;
    const double f13_rate = rate3 + 2 * zx_rate, f12_rate = 2 * a * (rate3 + zx_rate);
    const double f33_rate = f13_rate * zy + f13 * zy_rate;
    const double n_rate = g.k1 * (f13_rate * s1 + f13 * c1 * rate1) - f33_rate * x3 + damping * rate3;
    const double xi_rate = (n_rate - xi * f12_rate) * inv_f12;
    const double z = x4 - xi;
    const double s = s1 * cl + c1 * sl, c = c1 * cl - s1 * sl;
    const double hx = x5 + target.hx, hy = x6 + target.hy;
    const double half = 0.5 * inv_am * (1 + hx * hx + hy * hy);
    const double h5 = half * c, h6 = half * s, h1 = inv_am * (hx * s - hy * c);
    const double normal = -g.k5 * (h1 * g.k1 * (s1 - z * f13 * c1 * inv_f12) + x5 * h5 + x6 * h6);
    const double radial = -(f13 * zx * x3 - xi_rate) - g.k4 * z;
    const double transverse = -a * (g.k1 * f12 * s1 + f42 * z + g.k2 * x2);
    control_norm = std::sqrt(radial * radial + transverse * transverse + normal * normal);
    d = {rate1 + h1 * normal, transverse / a, rate3, f42 * x2 + (f12 + f13 * zx) * x3 + radial,
         h5 * normal,         h6 * normal,    n};
  }
};

}  // namespace

EpisodeResult SimulateWithOdeint(const EpisodeProblem& problem, const Gains& gains, double floor) {
  namespace odeint = boost::numeric::odeint;
  const CanonicalGains canonical = ToCanonical(gains, problem.gain_units);
  Loop loop{.target = problem.target, .g = canonical};
  auto stepper = odeint::make_controlled<odeint::runge_kutta_dopri5<State>>(
      problem.tolerance * floor * problem.settling_distance, problem.tolerance);
  const ErrorState& x = problem.initial_error;
  State y = {x.x1, x.x2, x.x3, x.x4, x.x5, x.x6, problem.target.initial_longitude};
  State rates;
  loop(y, rates, 0);
  EpisodeResult result;
  double fuel = 0;
  double time = 0;
  double step = problem.sampling_period / 8;
  bool outside = true;
  for (int k = 0;; ++k) {
    const TargetPhase phase = problem.target.PhaseAt(y[6]);
    outside = Distance({y[0], y[1], y[2], y[3], y[4], y[5]}, problem.target, phase) > problem.settling_distance;
    if (k < problem.horizon_samples) fuel += loop.control_norm / problem.gain_units.acceleration;
    if (outside) {
      result.fuel_sum = fuel;
      result.settling_samples = std::min(k + 1, problem.horizon_samples);
    }
    if (k == problem.horizon_samples) break;
    const double next = (k + 1) * problem.sampling_period;
    while (time < next) {
      const double wanted = std::min(step, next - time);
      double h = wanted;
      const bool accepted = stepper.try_step(std::ref(loop), y, time, h) == odeint::success;
      ++(accepted ? result.steps : result.rejected_steps);
      step = accepted && wanted < step ? std::max(step, h) : h;
      if (next - time < 1e-12) time = next;
    }
    loop(y, rates, time);  // ||u(k)||: the stepper keeps its last stage to itself
  }
  result.outcome = outside ? Outcome::kNotSettled : Outcome::kSettled;
  result.cost = result.settling_samples + problem.fuel_weight * result.fuel_sum;
  return result;
}

}  // namespace orbitune::bench
