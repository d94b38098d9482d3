// The time of day, as it is stored and told.
#pragma once

#include <chrono>
#include <cstdint>

namespace orbitune {

// Microseconds since the Unix epoch, UTC.
inline std::int64_t NowUs() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace orbitune
