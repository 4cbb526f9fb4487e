#pragma once

// Change points of series of values.

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <vector>

#include "screening/data_quality.hpp"

namespace kdl_calibration {

/// A series: one row per measured configuration, the medians over the repeats.
struct Series {
  std::vector<int> configurations;
  Eigen::MatrixXd values;
};

/// Values of one target or pair, in any order.
struct Repeats {
  std::vector<int> configurations;
  std::vector<double> values;  // of each row, one per axis
};

/// Piecewise constant level of a series by configuration.
struct Levels {
  std::vector<int> starts;       // first configuration of the second, third … level
  std::vector<int> last_before;  // the last one measured before it
  std::vector<Eigen::VectorXd> values;

  const Eigen::VectorXd& at(int configuration) const {
    const auto above = std::upper_bound(starts.begin(), starts.end(), configuration);
    return values[static_cast<std::size_t>(above - starts.begin())];
  }
};

Series series_of(const Repeats& repeats, Eigen::Index axes);

/// Levels of several series with a common sigma. `fitted`: number of parameters estimated from the same values.
/// `independent`: share of mutually independent values.
std::vector<Levels> find_levels(const std::vector<Series>& all, double fitted, double independent,
                                const QualityOptions& options);

}  // namespace kdl_calibration
