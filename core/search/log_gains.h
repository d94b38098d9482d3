// ln K: where CMA-ES and Nelder-Mead search, for gains differ by factors.
#pragma once

#include <Eigen/Core>

#include "core/search/options.h"

namespace orbitune {

using LogGains = Eigen::Matrix<double, kGainCount, 1>;

LogGains ToLog(const Gains& gains);
// Within the bounds of the options.
Gains FromLog(const SearchOptions& options, const LogGains& x);

}  // namespace orbitune
