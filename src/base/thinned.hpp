#pragma once

// A distribution in a few numbers. Not installed.

#include <algorithm>
#include <cstddef>
#include <vector>

namespace kdl_calibration {

/// Order statistics that a distribution is written down with.
constexpr std::size_t kMostOrderStatistics = 1000;

/// The values in ascending order; of more than `most` as many evenly spaced ones and the largest.
inline std::vector<double> thinned(std::vector<double> values, std::size_t most = kMostOrderStatistics) {
  std::sort(values.begin(), values.end());
  if (values.size() <= most) {
    return values;
  }
  std::vector<double> chosen;
  chosen.reserve(most + 1);
  for (std::size_t i = 0; i <= most; ++i) {
    chosen.push_back(values[i * (values.size() - 1) / most]);
  }
  return chosen;
}

}  // namespace kdl_calibration
