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

}  // namespace orbitune
