#pragma once

// Where a series of values steps from one level to another. Not installed.

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <vector>

#include "kdl_calibration/data_quality.hpp"

namespace kdl_calibration {

/// One row per configuration in which it was measured: the medians over the repeats.
struct Series {
  std::vector<int> configurations;
  Eigen::MatrixXd values;
};

/// What was measured of one target or pair, in any order.
struct Repeats {
  std::vector<int> configurations;
  std::vector<double> values;  // of each, one per axis
};

/// What a series is worth configuration by configuration: constant between its changes.
struct Levels {
  std::vector<int> starts;       // configuration in which the second, third … level begins
  std::vector<int> last_before;  // the one measured before it
  std::vector<Eigen::VectorXd> values;

  const Eigen::VectorXd& at(int configuration) const {
    const auto above = std::upper_bound(starts.begin(), starts.end(), configuration);
    return values[static_cast<std::size_t>(above - starts.begin())];
  }
};

Series series_of(const Repeats& repeats, Eigen::Index axes);

/// Levels of several series with one sigma. `fitted`: number of parameters that were estimated from the same values.
/// `independent`: share of the values that are independent of each other.
std::vector<Levels> find_levels(const std::vector<Series>& all, double fitted, double independent,
                                const QualityOptions& options);

}  // namespace kdl_calibration
