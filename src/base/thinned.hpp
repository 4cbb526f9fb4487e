#pragma once

// Distributions reduced to few order statistics.

#include <algorithm>
#include <cstddef>
#include <vector>

namespace kdl_calibration {

/// Largest number of order statistics written for a distribution.
constexpr std::size_t kMostOrderStatistics = 1000;

/// The values in ascending order; above `most` values, `most` evenly spaced ones and the largest.
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
