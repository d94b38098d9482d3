#include "client/cli/format.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <ctime>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"

namespace orbitune::cli {
namespace {

// An enum value's name without its prefix; the number where this client is older than the value.
std::string ShortName(const std::string& name, const char* prefix, int value) {
  return name.empty() ? std::to_string(value) : std::string(absl::StripPrefix(name, prefix));
}

std::string InWords(const std::string& name) { return absl::StrReplaceAll(absl::AsciiStrToLower(name), {{"_", " "}}); }

}  // namespace

std::string RoundTrip(double value) {
  std::array<char, 32> buffer{};
  const std::to_chars_result result = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return std::string(buffer.data(), result.ptr);
}

std::string Human(double value, int digits) { return absl::StrFormat("%.*g", digits, value); }

std::string Human(std::optional<double> value, int digits) { return value ? Human(*value, digits) : "-"; }

std::string Percent(std::optional<double> percent) { return percent ? absl::StrFormat("%.1f %%", *percent) : "-"; }

std::optional<double> ReductionPercent(std::optional<double> first, std::optional<double> cost) {
  if (!first || !cost || *first == 0) return std::nullopt;
  return 100 * (1 - *cost / *first);
}

std::string HumanDuration(double seconds) {
  if (!std::isfinite(seconds) || std::abs(seconds) > 1e15) return "-";
  if (seconds < 0.9995) return absl::StrFormat("%.0f ms", 1e3 * seconds);
  if (seconds < 59.95) return absl::StrFormat("%.3g s", seconds);
  const auto whole = static_cast<long long>(std::llround(seconds));
  if (whole < 3600) return absl::StrFormat("%d min %d s", whole / 60, whole % 60);
  return absl::StrFormat("%d h %d min", whole / 3600, whole % 3600 / 60);
}

std::string UtcTime(const google::protobuf::Timestamp& time) {
  const std::time_t seconds = time.seconds();
  std::tm parts{};
  if (gmtime_r(&seconds, &parts) == nullptr) return "-";
  std::array<char, 64> text{};
  return std::string(text.data(), std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &parts));
}

double SecondsBetween(const google::protobuf::Timestamp& start, const google::protobuf::Timestamp& end) {
  return static_cast<double>(end.seconds() - start.seconds()) + 1e-9 * (end.nanos() - start.nanos());
}

std::string GainsText(const v1::Gains& gains, int digits) {
  return absl::StrFormat("%.*g %.*g %.*g %.*g %.*g", digits, gains.k1(), digits, gains.k2(), digits, gains.k3(), digits,
                         gains.k4(), digits, gains.k5());
}

std::string StateText(v1::JobState state) { return ShortName(v1::JobState_Name(state), "JOB_STATE_", state); }

std::string OutcomeText(v1::Outcome outcome) {
  if (outcome == v1::OUTCOME_UNSPECIFIED) return "-";
  if (outcome == v1::OUTCOME_LEFT_DOMAIN) return "left the domain";
  return InWords(ShortName(v1::Outcome_Name(outcome), "OUTCOME_", outcome));
}

std::string GuaranteeText(v1::DomainGuarantee guarantee) {
  if (guarantee == v1::DOMAIN_GUARANTEE_UNSPECIFIED) return "-";
  return InWords(ShortName(v1::DomainGuarantee_Name(guarantee), "DOMAIN_GUARANTEE_", guarantee));
}

std::string EngineText(const v1::Engine& engine) {
  return absl::StrCat("Orbitune ", engine.version(), ", ", engine.simd_target(), ", multiply-add ",
                      engine.fused_multiply_add() ? "fused" : "not fused", ", ", engine.libraries());
}

bool Ended(v1::JobState state) {
  return state == v1::JOB_STATE_SUCCEEDED || state == v1::JOB_STATE_FAILED || state == v1::JOB_STATE_CANCELLED;
}

int ExpectedIterations(const v1::Job& job) {
  const std::int64_t done = job.completed_iterations();
  if (job.state() == v1::JOB_STATE_SUCCEEDED) return static_cast<int>(done);
  const std::int64_t iterations = job.hyperparameters().iterations();
  const std::int64_t budget = job.hyperparameters().max_episodes();
  const std::int64_t flown = job.latest_iteration().episodes();
  if (budget == 0 || flown == 0) return static_cast<int>(iterations);
  return static_cast<int>(std::max(
      done, std::min<std::int64_t>(iterations,
                                   static_cast<std::int64_t>(static_cast<double>(budget) / static_cast<double>(flown) *
                                                             static_cast<double>(done)))));
}

v1::Hyperparameters UsedHyperparameters(const v1::Job& job) {
  v1::Hyperparameters used = job.hyperparameters();
  if (used.algorithm() == v1::ALGORITHM_CMA_ES || used.algorithm() == v1::ALGORITHM_NELDER_MEAD) {
    used.clear_step_size();
    used.clear_exploration_scale();
    used.clear_directions();
    used.clear_exploration_std();
    used.clear_ars_variants();
  }
  if (used.algorithm() != v1::ALGORITHM_CMA_ES) used.clear_cma_es();
  if (used.algorithm() != v1::ALGORITHM_NELDER_MEAD) used.clear_nelder_mead();
  return used;
}

std::optional<double> CostOf(const v1::Iteration& iteration) {
  return iteration.has_cost() ? std::make_optional(iteration.cost()) : std::nullopt;
}

std::string Printable(const std::string& text) {
  std::string result = text;
  std::replace_if(
      result.begin(), result.end(), [](char c) { return absl::ascii_iscntrl(static_cast<unsigned char>(c)); }, '?');
  return result;
}

}  // namespace orbitune::cli
