#pragma once

#include <algorithm>
#include <vector>

namespace orbitune::bench {

// The upper one of an even number. values: not empty.
inline double Median(std::vector<double> values) {
  const auto middle = values.begin() + std::ssize(values) / 2;
  std::ranges::nth_element(values, middle);
  return *middle;
}

}  // namespace orbitune::bench
