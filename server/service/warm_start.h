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

// INVALID_ARGUMENT for "warm_start" unless the spec's gain units are those of the gains.
absl::Status CheckUnits(const WarmStart& start, const JobSpec& spec);

}  // namespace orbitune
