// What is said of gains once they are found: full-horizon episodes in physical units, and the warnings that matter.
#pragma once

#include "storage/job.h"

namespace orbitune {

// A spacecraft's chemical engine gives 0.1 to 0.5 m/s^2 (an apogee engine of 400-500 N on one to five tonnes); more
// than this is none.
inline constexpr double kChemicalEngineLimitMS2 = 1.0;

EpisodeReport ToReport(const EpisodeResult& result, const PreparedScenario& prepared);

// prepared: of each initial condition. results: of K(1), K(M) and the best K, in that order, each from every initial
// condition in theirs, over the full horizon with their effort measured.
JobReport BuildReport(const JobRecord& job, std::span<const PreparedScenario> prepared,
                      std::span<const EpisodeResult> results, std::int64_t pairs_left_out);

}  // namespace orbitune
