#pragma once

// Medians, and scales that a few wrong values do not spoil. Not installed.

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace kdl_calibration {

/// The mean of the two middle values where their number is even; 0 of none.
inline double median(std::vector<double> values) {
  if (values.empty()) {
    return 0.0;
  }
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) {
    return *middle;
  }
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

/// Of the columns of the rows [first, end).
Eigen::VectorXd medians(const Eigen::MatrixXd& values, Eigen::Index first, Eigen::Index end);

/// Sigma of centred normal values among which there may be others: the median absolute deviation says which to leave
/// out, the root mean square of the rest is more exact than it.
double robust_sigma(std::vector<double> centred);

/// Degrees of freedom that this sigma is worth over those of the root mean square of clean values, with some reserve.
constexpr double kEfficiency = 0.8;

/// A robust sigma and the degrees of freedom that it is worth.
struct Scatter {
  double sigma = std::numeric_limits<double>::infinity();
  double freedom = 0.0;
};

/// Of centred values, from which `fitted` parameters were estimated; infinite where nothing is left to tell it.
Scatter scatter_of(const std::vector<double>& centred, double fitted, double floor);

/// What the norm over such a sigma exceeds with probability false_alarm / comparisons: the normal quantile z, turned
/// into Student's (Wallace 1959, the inverse of his approximation).
double threshold(double false_alarm, double comparisons, Eigen::Index axes, double freedom);

}  // namespace kdl_calibration
