#pragma once

// Medians and robust scales.

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace kdl_calibration {

/// The mean of the two middle values for an even number; 0 without values.
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

/// Medians of the columns over the rows [first, end).
Eigen::VectorXd medians(const Eigen::MatrixXd& values, Eigen::Index first, Eigen::Index end);

/// Robust sigma of centred normal values with outliers: the median absolute deviation decides which to leave out. The
/// root mean square of the rest is more efficient than it.
double robust_sigma(std::vector<double> centred);

/// Degrees of freedom of this sigma relative to the root mean square of clean values, with a margin.
constexpr double kEfficiency = 0.8;

/// A robust sigma and its degrees of freedom.
struct Scatter {
  double sigma = std::numeric_limits<double>::infinity();
  double freedom = 0.0;
};

/// Scatter of centred values from which `fitted` parameters were estimated; infinite without degrees of freedom.
Scatter scatter_of(const std::vector<double>& centred, double fitted, double floor);

/// Limit of the norm over such a sigma, exceeded with probability false_alarm / comparisons: the normal quantile
/// converted to Student's (inverse of the approximation of Wallace 1959).
double threshold(double false_alarm, double comparisons, Eigen::Index axes, double freedom);

}  // namespace kdl_calibration
