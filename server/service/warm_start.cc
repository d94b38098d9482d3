#include "server/service/warm_start.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "storage/serialise.h"

namespace orbitune {
namespace {

constexpr std::string_view kField = "warm_start";
constexpr std::string_view kJobs = "jobs/";
constexpr std::string_view kGainSets = "gainSets/";

absl::Status Fault(std::string_view allowed, std::string_view received) {
  FieldErrors errors;
  errors.Add(kField, allowed, received);
  return errors.ToStatus();
}

absl::StatusOr<WarmStart> FromJob(const JobStore& store, const std::string& name) {
  const auto job = store.GetJob(name.substr(kJobs.size()));
  if (absl::IsNotFound(job.status())) return Fault("the name of a job that there is", FormatReceived(name));
  if (!job.ok()) return job.status();
  if (!IsTerminal(job->state) || !job->best || !HasCost(job->best->outcome)) {
    return Fault("a job that has ended, and found gains with a cost",
                 absl::StrCat(name, ", which is ", ToAbsl(NameOf(job->state)), " with ", job->completed_iterations(),
                              " iterations"));
  }
  const auto prepared = Prepare(job->spec.scenario, job->spec.initial_condition);
  if (!prepared.ok()) return prepared.status();
  return WarmStart{job->best->gains, prepared->velocity_unit_m_s, prepared->acceleration_unit_m_s2};
}

bool Same(double a, double b) { return std::abs(a - b) <= 1e-9 * std::abs(a); }

}  // namespace

absl::StatusOr<WarmStart> FindWarmStart(const JobStore& store, const GainSetSource& gain_sets,
                                        const std::string& name) {
  if (name.starts_with(kJobs)) return FromJob(store, name);
  if (!name.starts_with(kGainSets) || !gain_sets) return Fault("jobs/ID or gainSets/ID", FormatReceived(name));
  auto gains = gain_sets(name.substr(kGainSets.size()));
  if (absl::IsNotFound(gains.status())) return Fault("the name of a gain set that there is", FormatReceived(name));
  return gains;
}

absl::Status CheckUnits(const WarmStart& start, const JobSpec& spec) {
  const auto prepared = Prepare(spec.scenario, spec.initial_condition);
  if (!prepared.ok()) return prepared.status();
  if (!Same(prepared->velocity_unit_m_s, start.velocity_unit_m_s) ||
      !Same(prepared->acceleration_unit_m_s2, start.acceleration_unit_m_s2)) {
    return Fault(absl::StrFormat("gains in units of %g m/s and %g m/s^2, as this scenario's",
                                 prepared->velocity_unit_m_s, prepared->acceleration_unit_m_s2),
                 absl::StrFormat("%g m/s and %g m/s^2", start.velocity_unit_m_s, start.acceleration_unit_m_s2));
  }
  return absl::OkStatus();
}

}  // namespace orbitune
