// Where a job's K(1) comes from, if not from its options: the best gains of another job, or a gain set.
#pragma once

#include <functional>
#include <string>

#include "storage/job_store.h"

namespace orbitune {

// Gains and what one of their units is.
struct WarmStart {
  Gains gains{};
  double velocity_unit_m_s = 0;
  double acceleration_unit_m_s2 = 0;
};

// The gains of gainSets/{id}; NOT_FOUND if there is none.
using GainSetSource = std::function<absl::StatusOr<WarmStart>(const std::string& id)>;

// name: jobs/ID of a job that has ended with a best iteration, or gainSets/ID (gain_sets empty: there are none).
// INVALID_ARGUMENT for "warm_start" where it is neither, or there is nothing of that name.
absl::StatusOr<WarmStart> FindWarmStart(const JobStore& store, const GainSetSource& gain_sets, const std::string& name);

// Makes the gains K(1) of the spec, raised to its gain floor. INVALID_ARGUMENT for "warm_start" if the spec's gain
// units are others.
absl::Status ApplyWarmStart(const WarmStart& start, JobSpec& spec);

}  // namespace orbitune
