#include "core/sim/scalar_simulator.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/control/certificate.h"

namespace orbitune {
namespace {

// x1..x6, the target's longitude, and the integral of ||u|| (which never steers the step size).
enum : std::size_t { kLongitude = 6, kDeltaV = 7, kStateSize = 8 };
using State = std::array<double, kStateSize>;

// Dormand and Prince, "A family of embedded Runge-Kutta formulae", J. Comp. Appl. Math. 6 (1980), table 2: RK5(4)7M.
constexpr int kStages = 7;
constexpr double kA[kStages][kStages - 1] = {
    {},
    {1.0 / 5},
    {3.0 / 40, 9.0 / 40},
    {44.0 / 45, -56.0 / 15, 32.0 / 9},
    {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
    {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
    {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84},
};
constexpr double kError[kStages] = {71.0 / 57600,      0,          -71.0 / 16695, 71.0 / 1920,
                                    -17253.0 / 339200, 22.0 / 525, -1.0 / 40};

// Step size control: Gustafsson's PI controller for a fifth-order pair (Hairer, Norsett, Wanner I, IV.2).
constexpr double kSafety = 0.9;
constexpr double kProportional = 0.21;  // 1/4 - 0.04: the error per sampling period goes with the fourth power
constexpr double kIntegral = 0.04;
constexpr double kLargestGrowth = 5;
constexpr double kLargestShrink = 0.2;

// What this simulator flies is read by people: it is a hundred times finer than the tolerance asks for.
constexpr double kFine = 1e-2;
// The least local error, relative to the state, that a step is asked for: roundoff is not far.
constexpr double kRoundoff = 1e-13;
// Steps are measured against max(|x|, this fraction of the settling distance): below it nothing counts any more.
constexpr double kNegligible = 1e-2;
// The edge of the domain is singular: steps shrink before it, and no trajectory comes back from so near (1 + x2 = 1e-4
// is a semi-parameter of 1e-8 p_r, a = 1e-4 a radius of 1e4 p_r).
constexpr double kAtEdge = 1e-4;
// An episode whose steps have shrunk to nothing this near the edge has met the edge; elsewhere it is too stiff.
constexpr double kNearEdge = 1e-2;

enum class StepEnd { kAccepted, kInaccurate, kOutside };

ErrorState ErrorOf(const State& y) { return {y[0], y[1], y[2], y[3], y[4], y[5]}; }

class Episode {
 public:
  Episode(const EpisodeProblem& problem, const Gains& gains, const EpisodeOptions& options)
      : problem_(problem),
        options_(options),
        gains_(ToCanonical(gains, problem.gain_units)),
        settled_below_(options.early_exit && problem.hold == ControlHold::kContinuous
                           ? SettlingLyapunov(problem.settling_distance, problem.target, gains_.k1)
                           : -1) {
    const ErrorState& x = problem.initial_error;
    y_ = {x.x1, x.x2, x.x3, x.x4, x.x5, x.x6, problem.target.initial_longitude, 0};
  }

  EpisodeResult Run() {
    if (!InDomain(ErrorOf(y_), PhaseOf(y_))) return EndEarly(Outcome::kLeftDomain);
    step_ = problem_.sampling_period / 8;
    for (int sample = 0;; ++sample) {
      time_ = sample * problem_.sampling_period;
      if (!TakeSample(sample)) return EndEarly(Outcome::kNumericalFailure);
      if (sample == problem_.horizon_samples) break;
      if (law_.lyapunov <= settled_below_) return Settle();
      if (options_.cancelled && options_.cancelled()) return EndEarly(Outcome::kNumericalFailure);
      const Outcome outcome = AdvanceTo((sample + 1) * problem_.sampling_period);
      if (outcome != Outcome::kSettled) return EndEarly(outcome);
    }
    if (options_.measure_effort) result_.delta_v_horizon = y_[kDeltaV];
    return Settle();
  }

 private:
  TargetPhase PhaseOf(const State& y) const { return problem_.target.PhaseAt(y[kLongitude]); }

  // Evaluates the law and the rates at y. False outside the domain.
  bool Rates(const State& y, LawValue& law, State& rates) const {
    const ErrorState x = ErrorOf(y);
    const TargetPhase phase = PhaseOf(y);
    if (!InDomain(x, phase)) return false;
    law = EvaluateLaw(x, problem_.target, phase, gains_);
    const Control& u = problem_.hold == ControlHold::kContinuous ? law.u : held_;
    const ErrorState d = ErrorRates(x, problem_.target, phase, u);
    rates = {
        d.x1, d.x2, d.x3, d.x4, d.x5, d.x6, TargetOrbit::LongitudeRate(phase), options_.measure_effort ? u.norm() : 0};
    return true;
  }

  // Books sample k; false if the state is not finite.
  bool TakeSample(int k) {
    if (k == 0 || problem_.hold == ControlHold::kZeroOrder) {
      law_ = EvaluateLaw(ErrorOf(y_), problem_.target, PhaseOf(y_), gains_);
      held_ = law_.u;
      Rates(y_, law_, rates_[0]);
      NotePeak();
    }
    const double distance = Distance(ErrorOf(y_), problem_.target, PhaseOf(y_));
    const double control = law_.u.norm() / problem_.gain_units.acceleration;
    if (!std::isfinite(distance) || !std::isfinite(control)) return false;
    if (k == 0) result_.initial_lyapunov = law_.lyapunov;
    if (options_.trajectory != nullptr) {
      options_.trajectory->push_back({k, y_[kLongitude], ErrorOf(y_), law_.u, law_.lyapunov, distance});
    }
    outside_ = distance > problem_.settling_distance;
    if (k < problem_.horizon_samples) fuel_ += control;
    if (outside_) {
      result_.settling_samples = std::min(k + 1, problem_.horizon_samples);
      settling_fuel_ = fuel_;
    }
    if (k == result_.settling_samples && options_.measure_effort) result_.delta_v_to_settling = y_[kDeltaV];
    return true;
  }

  // kSettled stands for "arrived".
  Outcome AdvanceTo(double target_time) {
    while (time_ < target_time) {
      const double remaining = target_time - time_;
      const bool last = step_ >= remaining * (1 - 1e-10);
      const double h = last ? remaining : std::min(step_, remaining / 2);
      const StepEnd end = TryStep(h);
      if (end == StepEnd::kAccepted) {
        time_ = last ? target_time : time_ + h;
        ++result_.steps;
        // A step cut short to meet a sample says little about the next one's size.
        step_ = h < step_ ? std::max(step_, next_step_) : next_step_;
        NotePeak();
        if (Margin() < kAtEdge) return Outcome::kLeftDomain;
      } else {
        ++result_.rejected_steps;
        step_ = next_step_;
      }
      if (Abandoned()) return Outcome::kNumericalFailure;
      const bool stuck = step_ < 1e-13 * std::max(1.0, time_) ||
                         result_.steps + result_.rejected_steps > MaxStepAttempts(problem_.horizon_samples);
      if (stuck) return Margin() < kNearEdge ? Outcome::kLeftDomain : Outcome::kNumericalFailure;
    }
    return Outcome::kSettled;
  }

  // A sample may take any number of steps: asked every so many.
  bool Abandoned() const {
    constexpr int kStepsAtOnce = 4096;  // some milliseconds
    const int attempts = result_.steps + result_.rejected_steps;
    return attempts % kStepsAtOnce == 0 && options_.cancelled && options_.cancelled();
  }

  // One attempt of size h from y_ (rates_[0] and law_ belong to it); leaves the size to go on with in next_step_.
  StepEnd TryStep(double h) {
    State y;
    LawValue law;
    for (std::size_t stage = 1; stage < kStages; ++stage) {
      for (std::size_t i = 0; i < kStateSize; ++i) {
        double sum = 0;
        for (std::size_t j = 0; j < stage; ++j) sum += kA[stage][j] * rates_[j][i];
        y[i] = y_[i] + h * sum;
      }
      if (!Rates(y, law, rates_[stage])) {
        next_step_ = h / 4;
        return StepEnd::kOutside;
      }
    }
    const double error = ErrorNorm(y, h);
    if (!(error <= 1)) {
      const double shrink = std::isfinite(error) ? kSafety * std::pow(error, -0.25) : kLargestShrink;
      next_step_ = h * std::max(kLargestShrink, shrink);
      after_rejection_ = true;
      return StepEnd::kInaccurate;
    }
    const double bounded = std::max(error, 1e-10);
    double growth = kSafety * std::pow(bounded, -kProportional) * std::pow(previous_error_, kIntegral);
    growth = std::clamp(growth, kLargestShrink, after_rejection_ ? 1 : kLargestGrowth);
    next_step_ = h * growth;
    previous_error_ = std::max(error, 1e-4);
    after_rejection_ = false;
    y_ = y;
    law_ = law;
    rates_[0] = rates_[kStages - 1];
    return StepEnd::kAccepted;
  }

  // Where the loop is stiff, h K > 1, a component's error counts (h K)^2 times: the control, which is what the cost is
  // made of, holds it K times.
  double ErrorNorm(const State& y, double h) const {
    double size = kNegligible * problem_.settling_distance;
    // A longitude error of whole turns is none.
    size = std::max({size, std::abs(2 * std::sin(y_[0] / 2)), std::abs(2 * std::sin(y[0] / 2))});
    for (std::size_t i = 1; i < kLongitude; ++i) size = std::max({size, std::abs(y_[i]), std::abs(y[i])});
    const auto stiffness = [h](double gain) { return std::max(1.0, h * gain * h * gain); };
    const double hx = y[4] + problem_.target.hx, hy = y[5] + problem_.target.hy;
    const double half =
        (1 + hx * hx + hy * hy) / (2 * InverseRadius(ErrorOf(y), PhaseOf(y)) * (1 + y[1]));  // |(H5, H6)|
    const double at_normal = stiffness(gains_.k5 * half * half);
    const double weight[] = {1,        stiffness(gains_.k2), 1, stiffness(std::max(gains_.k3, gains_.k4)), at_normal,
                             at_normal};
    const double tolerance = std::max(kFine * problem_.tolerance * h / problem_.sampling_period, kRoundoff);
    double largest = 0;
    double sum = 0;
    for (std::size_t i = 0; i <= kLongitude; ++i) {
      double error = 0;
      for (std::size_t j = 0; j < kStages; ++j) error += kError[j] * rates_[j][i];
      const double relative = i == kLongitude ? error : error * weight[i] / size;
      largest = std::max(largest, std::abs(h * relative) / tolerance);
      sum += error;
    }
    // A stage that ran away leaves an infinity or a NaN, which std::max would drop.
    return std::isfinite(sum) && std::isfinite(size) ? largest : std::numeric_limits<double>::infinity();
  }

  void NotePeak() {
    if (!options_.measure_effort) return;
    const Control& u = problem_.hold == ControlHold::kContinuous ? law_.u : held_;
    if (!(u.norm() <= result_.peak_acceleration)) result_.peak_acceleration = u.norm();
  }

  double MomentumRatio() const { return 1 + y_[1]; }
  double Margin() const { return std::min(MomentumRatio(), InverseRadius(ErrorOf(y_), PhaseOf(y_))); }

  EpisodeResult EndEarly(Outcome outcome) {
    result_.outcome = outcome;
    result_.end_time = time_;
    result_.settling_samples = 0;
    result_.delta_v_to_settling = kUnset;
    result_.momentum_ratio = MomentumRatio();
    result_.inverse_radius = InverseRadius(ErrorOf(y_), PhaseOf(y_));
    return result_;
  }

  EpisodeResult Settle() {
    result_.outcome = outside_ ? Outcome::kNotSettled : Outcome::kSettled;
    result_.end_time = time_;
    result_.fuel_sum = settling_fuel_;
    result_.cost = result_.settling_samples + problem_.fuel_weight * settling_fuel_;
    return result_;
  }

  const EpisodeProblem& problem_;
  const EpisodeOptions& options_;
  const CanonicalGains gains_;
  const double settled_below_;  // c*

  double time_ = 0;
  State y_{};
  LawValue law_;  // at y_
  Control held_;
  std::array<State, kStages> rates_{};
  double step_ = 0;
  double next_step_ = 0;
  double previous_error_ = 1e-4;
  bool after_rejection_ = false;

  bool outside_ = true;
  double fuel_ = 0;           // sum of ||u(k)|| so far
  double settling_fuel_ = 0;  // up to the last sample outside
  EpisodeResult result_;
};

}  // namespace

EpisodeResult SimulateEpisode(const EpisodeProblem& problem, const Gains& gains, const EpisodeOptions& options) {
  return Episode(problem, gains, options).Run();
}

}  // namespace orbitune
