// A job for people: its details, and the summary at its end.
#pragma once

#include <ostream>

#include "orbitune/v1/tuning.pb.h"

namespace orbitune::cli {

// What a job that has ended came to: gains, before and after, warnings; or the error where it FAILED.
void PrintJobSummary(const v1::Job& job, std::ostream& out);

// Everything a job is set to and where it stands; the summary where it has ended.
void PrintJob(const v1::Job& job, std::ostream& out);

}  // namespace orbitune::cli
