#include "core/search/cma_es.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "core/base/random.h"

namespace orbitune {
namespace {

constexpr double kN = kGainCount;
// A run has converged when its longest axis is below this in ln K, or the costs of a generation are as good as equal.
constexpr double kSmallestAxis = 1e-4;
constexpr double kSmallestSpread = 1e-7;
// Between the axes of C; beyond, rounding decides.
constexpr double kLargestCondition = 1e14;
constexpr double kLargestSigma = 10;

// The tutorial's Table 1 for lambda candidates.
struct Constants {
  std::vector<double> weights;  // w_i, the negative ones too
  int mu = 0;
  double mu_eff = 0;
  double c_sigma = 0;
  double d_sigma = 0;
  double c_c = 0;
  double c_1 = 0;
  double c_mu = 0;
};

// (sum w)^2 / sum w^2.
double EffectiveSize(std::span<const double> weights) {
  const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
  return sum * sum / std::inner_product(weights.begin(), weights.end(), weights.begin(), 0.0);
}

void Scale(std::span<double> weights, double sum) {
  const double factor = sum / std::abs(std::accumulate(weights.begin(), weights.end(), 0.0));
  for (double& w : weights) w *= factor;
}

Constants ConstantsFor(int lambda) {
  Constants c;
  for (int i = 1; i <= lambda; ++i) c.weights.push_back(std::log((lambda + 1) / 2.0) - std::log(i));
  c.mu = lambda / 2;
  const std::span all(c.weights);
  const auto positive = all.first(static_cast<std::size_t>(c.mu));
  const auto negative = all.subspan(static_cast<std::size_t>(c.mu));
  c.mu_eff = EffectiveSize(positive);
  const double mu_eff_minus = EffectiveSize(negative);
  c.c_sigma = (c.mu_eff + 2) / (kN + c.mu_eff + 5);
  c.d_sigma = 1 + 2 * std::max(0.0, std::sqrt((c.mu_eff - 1) / (kN + 1)) - 1) + c.c_sigma;
  c.c_c = (4 + c.mu_eff / kN) / (kN + 4 + 2 * c.mu_eff / kN);
  c.c_1 = 2 / ((kN + 1.3) * (kN + 1.3) + c.mu_eff);
  c.c_mu = std::min(1 - c.c_1, 2 * (0.25 + c.mu_eff + 1 / c.mu_eff - 2) / ((kN + 2) * (kN + 2) + c.mu_eff));
  Scale(positive, 1);
  Scale(negative,
        std::min({1 + c.c_1 / c.c_mu, 1 + 2 * mu_eff_minus / (c.mu_eff + 2), (1 - c.c_1 - c.c_mu) / (kN * c.c_mu)}));
  return c;
}

// E ||N(0, I)||.
double ExpectedLength() { return std::sqrt(kN) * (1 - 1 / (4 * kN) + 1 / (21 * kN * kN)); }

}  // namespace

CmaEs::CmaEs(const SearchOptions& options) : Optimiser(options), best_(ToLog(options.initial_gains)) {
  BeginRun(best_, 1);
  Begin();
}

int CmaEs::Population() const {
  const double lambda = options().cma_es.population * std::pow(options().cma_es.population_growth, run_);
  return static_cast<int>(std::min<double>(std::round(lambda), SearchOptions::kMaxPopulation));
}

// flown: episodes before it.
void CmaEs::BeginRun(const LogGains& mean, std::int64_t flown) {
  const std::int64_t left = options().max_episodes - flown;
  const int runs_left = options().cma_es.restarts + 1 - run_;
  run_end_ = options().max_episodes == 0 || runs_left < 1 ? 0 : flown + left / runs_left;
  generation_ = 0;
  mean_ = mean;
  sigma_ = options().cma_es.initial_sigma;
  covariance_.setIdentity();
  path_sigma_.setZero();
  path_c_.setZero();
}

void CmaEs::Propose(std::vector<Gains>& batch) {
  batch.clear();
  samples_.clear();
  if (iteration() == 1) {
    batch.push_back(options().initial_gains);
    return;
  }
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(covariance_);
  axes_ = eigen.eigenvectors();
  lengths_ = eigen.eigenvalues().cwiseMax(eigen.eigenvalues().maxCoeff() / kLargestCondition).cwiseSqrt();
  for (int k = 0; k < Population(); ++k) {
    const RandomKey key{.seed = options().seed,
                        .stream = RandomStream::kCmaEs,
                        .a = static_cast<std::uint32_t>(iteration()),
                        .b = static_cast<std::uint32_t>(k)};
    LogGains z;
    for (int i = 0; i < kGainCount; ++i) z[i] = StandardNormal(key, static_cast<std::uint32_t>(i));
    samples_.push_back(mean_ + sigma_ * (axes_ * lengths_.cwiseProduct(z)));
    batch.push_back(FromReflectedLog(options(), samples_.back()));
  }
}

absl::StatusOr<IterationRecord> CmaEs::Learn(std::span<const EpisodeResult> results) {
  IterationRecord record = RecordOfCandidates(batch(), results);
  const bool none = !HasCost(record.outcome);
  if (iteration() > 1 && none && !HasCost(best_result_.outcome)) {
    return absl::FailedPreconditionError(
        absl::StrCat("iteration ", iteration(), ": K(1) and all ", results.size(),
                     " candidates left the domain or failed, so there is no cost to improve"));
  }
  const EpisodeResult result{.outcome = record.outcome, .cost = record.cost};
  if (iteration() == 1 || BetterResult(result, best_result_)) {
    best_ = ToLog(record.gains);
    best_result_ = result;
  }
  if (iteration() == 1) return record;
  if (none) {
    sigma_ /= 2;
  } else {
    Adapt(results);
  }
  ++generation_;
  const std::int64_t flown = episodes() + std::ssize(results);
  if (RunIsOver(record, flown)) {
    ++run_;
    BeginRun(best_, flown);
  }
  return record;
}

// One generation, the tutorial's equations (41) to (47).
void CmaEs::Adapt(std::span<const EpisodeResult> results) {
  const Constants c = ConstantsFor(static_cast<int>(results.size()));
  std::vector<std::size_t> order(results.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) { return BetterResult(results[a], results[b]); });
  std::vector<LogGains> y;  // (x - m) / sigma, the best first
  for (const std::size_t k : order) y.push_back((samples_[k] - mean_) / sigma_);

  LogGains step = LogGains::Zero();  // <y>_w
  for (int i = 0; i < c.mu; ++i) step += c.weights[static_cast<std::size_t>(i)] * y[static_cast<std::size_t>(i)];
  mean_ += sigma_ * step;
  const Matrix whiten = axes_ * lengths_.cwiseInverse().asDiagonal() * axes_.transpose();  // C^(-1/2)
  path_sigma_ = (1 - c.c_sigma) * path_sigma_ + std::sqrt(c.c_sigma * (2 - c.c_sigma) * c.mu_eff) * (whiten * step);
  const double length = path_sigma_.norm();
  const double settled_in = 1 - std::pow(1 - c.c_sigma, 2.0 * (generation_ + 1));
  const bool h_sigma = length / std::sqrt(settled_in) < (1.4 + 2 / (kN + 1)) * ExpectedLength();
  path_c_ = (1 - c.c_c) * path_c_;
  if (h_sigma) path_c_ += std::sqrt(c.c_c * (2 - c.c_c) * c.mu_eff) * step;

  double sum_of_weights = 0;
  Matrix rank_mu = Matrix::Zero();
  for (std::size_t i = 0; i < y.size(); ++i) {
    sum_of_weights += c.weights[i];
    const double w = c.weights[i] >= 0 ? c.weights[i] : c.weights[i] * kN / ((whiten * y[i]).squaredNorm() + 1e-30);
    rank_mu += w * (y[i] * y[i].transpose());
  }
  const double stalled = h_sigma ? 0 : c.c_1 * c.c_c * (2 - c.c_c);
  covariance_ = (1 + stalled - c.c_1 - c.c_mu * sum_of_weights) * covariance_ +
                c.c_1 * (path_c_ * path_c_.transpose()) + c.c_mu * rank_mu;
  sigma_ = std::min(sigma_ * std::exp(c.c_sigma / c.d_sigma * (length / ExpectedLength() - 1)), kLargestSigma);
}

bool CmaEs::RunIsOver(const IterationRecord& record, std::int64_t flown) const {
  const double axis = sigma_ * std::sqrt(covariance_.diagonal().maxCoeff());
  const bool flat = HasCost(record.outcome) && record.cost_std <= kSmallestSpread * std::abs(record.cost);
  return axis < kSmallestAxis || flat || (run_end_ > 0 && flown + Population() > run_end_);
}

void CmaEs::Save(std::vector<double>& state) const {
  for (const double value : {static_cast<double>(run_), static_cast<double>(generation_), static_cast<double>(run_end_),
                             sigma_, static_cast<double>(best_result_.outcome), best_result_.cost}) {
    state.push_back(value);
  }
  for (const LogGains* v : {&mean_, &path_sigma_, &path_c_, &best_}) state.insert(state.end(), v->begin(), v->end());
  const auto c = covariance_.reshaped();
  state.insert(state.end(), c.begin(), c.end());
}

bool CmaEs::Restore(std::span<const double> state, const IterationRecord&) {
  constexpr std::size_t kSize = 6 + 4 * kGainCount + kGainCount * kGainCount;
  if (state.size() != kSize || !(state[4] >= 0 && state[4] <= static_cast<double>(Outcome::kNumericalFailure))) {
    return false;
  }
  run_ = static_cast<int>(state[0]);
  generation_ = static_cast<int>(state[1]);
  run_end_ = static_cast<std::int64_t>(state[2]);
  sigma_ = state[3];
  best_result_ = {.outcome = static_cast<Outcome>(static_cast<int>(state[4])), .cost = state[5]};
  const double* next = state.data() + 6;
  for (LogGains* v : {&mean_, &path_sigma_, &path_c_, &best_}) {
    *v = Eigen::Map<const LogGains>(next);
    next += kGainCount;
  }
  covariance_ = Eigen::Map<const Matrix>(next);
  return sigma_ > 0 && covariance_.allFinite() && mean_.allFinite();
}

}  // namespace orbitune
