#include "core/search/log_gains.h"

#include <cmath>

namespace orbitune {

LogGains ToLog(const Gains& gains) {
  LogGains x;
  for (int i = 0; i < kGainCount; ++i) x[i] = std::log(gains[static_cast<std::size_t>(i)]);
  return x;
}

Gains FromLog(const SearchOptions& options, const LogGains& x) {
  Gains k;
  for (int i = 0; i < kGainCount; ++i) k[static_cast<std::size_t>(i)] = std::exp(x[i]);
  return WithinBounds(options, k);
}

Gains FromReflectedLog(const SearchOptions& options, LogGains x) {
  const double low = std::log(options.gain_floor);
  const double width = std::log(SearchOptions::kMaxGain) - low;
  for (double& coordinate : x) {
    const double beyond = std::abs(std::remainder(coordinate - low, 2 * width));  // in [0, width]
    coordinate = low + beyond;
  }
  return FromLog(options, x);
}

}  // namespace orbitune
