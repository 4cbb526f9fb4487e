#include "base/robust_statistics.hpp"

#include <cmath>

#include "base/distributions.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kNormalOverMad = 1.4826;             // sigma / median absolute deviation of normal values
constexpr double kTrim = 3.0;                         // in sigmas
constexpr double kNormalOverTrimmed = 1.0 / 0.98658;  // sigma / that of normal values truncated at kTrim

}  // namespace

VectorXd medians(const MatrixXd& values, Index first, Index end) {
  VectorXd result(values.cols());
  for (Index axis = 0; axis < values.cols(); ++axis) {
    const auto column = values.col(axis).segment(first, end - first);
    result[axis] = median({column.begin(), column.end()});
  }
  return result;
}

double robust_sigma(std::vector<double> centred) {
  for (double& value : centred) {
    value = std::abs(value);
  }
  const double first = kNormalOverMad * median(centred);
  double sum = 0.0;
  double count = 0.0;
  for (const double value : centred) {
    if (value <= kTrim * first) {
      sum += value * value;
      count += 1.0;
    }
  }
  return count > 0.0 ? kNormalOverTrimmed * std::sqrt(sum / count) : 0.0;
}

Scatter scatter_of(const std::vector<double>& centred, double fitted, double floor) {
  const double rest = static_cast<double>(centred.size()) - fitted;
  if (rest <= 0.0) {
    return {};
  }
  const double sigma = robust_sigma(centred) * std::sqrt(static_cast<double>(centred.size()) / rest);
  return {.sigma = std::max(sigma, floor), .freedom = kEfficiency * rest};
}

double threshold(double false_alarm, double comparisons, Index axes, double freedom) {
  const double probability = std::min(false_alarm, 1.0) / std::max(comparisons, 1.0);
  const double z = norm_critical(probability, static_cast<int>(axes));
  const double n = std::max(freedom, 1.0);
  const double corrected = z * (8.0 * n + 3.0) / (8.0 * n + 1.0);
  return std::sqrt(n * std::expm1(corrected * corrected / n));
}

}  // namespace kdl_calibration
