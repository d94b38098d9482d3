// What a store's writer counts, for whoever shows it.
#pragma once

#include "core/base/histogram.h"

namespace orbitune {

struct StoreMetrics {
  Histogram commit_s{Histogram::Exponential(0.000125, 2, 16)};  // a group, until it is on disk; up to 4 s
  Histogram group_size{Histogram::Exponential(1, 2, 11)};       // operations of a commit
};

}  // namespace orbitune
