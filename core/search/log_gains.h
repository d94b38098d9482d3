// ln K: where CMA-ES and Nelder-Mead search, for gains differ by factors.
#pragma once

#include <Eigen/Core>

#include "core/search/options.h"

namespace orbitune {

using LogGains = Eigen::Matrix<double, kGainCount, 1>;

LogGains ToLog(const Gains& gains);
// Within the bounds of the options: a coordinate beyond one is drawn back to it.
Gains FromLog(const SearchOptions& options, const LogGains& x);
// The same, but a coordinate beyond a bound is reflected by it, as often as need be: what lies outside is a mirror
// image of the inside, and a cloud of samples keeps its width at a bound.
Gains FromReflectedLog(const SearchOptions& options, LogGains x);

}  // namespace orbitune
