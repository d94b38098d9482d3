// The order of outcomes from the best to the worst, for whoever sums up several episodes.
#pragma once

#include "core/sim/episode.h"

namespace orbitune {

// The more, the worse.
inline int Severity(Outcome outcome) {
  switch (outcome) {
    case Outcome::kSettled:
      return 0;
    case Outcome::kNotSettled:
      return 1;
    case Outcome::kNumericalFailure:
      return 2;
    case Outcome::kLeftDomain:
      break;
  }
  return 3;
}

}  // namespace orbitune
