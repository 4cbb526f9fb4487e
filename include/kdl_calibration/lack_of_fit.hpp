#pragma once

#include <Eigen/Core>
#include <vector>

#include "kdl_calibration/least_squares.hpp"

namespace kdl_calibration {

/// Lack of fit: the residuals of the means against the scatter of the repeats, both whitened with that scatter.
///   F = [cost of the means / (coordinates of the means - rank)] / 1
/// which follows the F distribution with these degrees of freedom and those of the scatter if geometry explains all
/// but noise (Draper and Smith, Applied Regression Analysis, lack of fit).
struct LackOfFit {
  double f = 0.0;
  double degrees_of_freedom = 0.0;         ///< of the numerator
  double repeat_degrees_of_freedom = 0.0;  ///< of the denominator
  double p_value = 1.0;                    ///< chance of an F as large if geometry explained everything
  /// Share of the residuals' variance that a function a + b sin q + c cos q of each joint would explain.
  std::vector<double> explained_by_joint;
};

/// Residual vectors (measured mean minus predicted, in W) of every target of every training configuration, explained
/// by each joint: entry j is 1 - (residual sum of squares with a + b sin q_j + c cos q_j) / (total sum of squares).
std::vector<double> explained_by_joints(const ErrorModel& model, const Estimate& estimate,
                                        const Measurements& measurements);

}  // namespace kdl_calibration
