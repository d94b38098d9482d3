// How far a thread steps back for others.
#pragma once

#include <sys/resource.h>

namespace orbitune {

// Added to the calling thread's own, as Linux has it; more than 0 lets others go first. Where the system refuses, it
// stays as it was.
inline void AddNice(int nice) {
  if (nice != 0) setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + nice);
}

// Of threads that fly episodes, which take all the time there is.
inline constexpr int kFlightNice = 5;

}  // namespace orbitune
