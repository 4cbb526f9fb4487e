#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "estimation/least_squares.hpp"

namespace kdl_calibration {

/// Lack of fit compares residuals at the weighted solution with the scatter of the repeats. For the means over targets
/// and for the targets' deviations from them, along each axis of W, the ratio
///   F = (residual sum of squares / its degrees of freedom) / variance of the repeats
/// follows the F distribution if the model explains all but noise (Draper and Smith, Applied Regression Analysis, lack
/// of fit; Satterthwaite's degrees of freedom if the variance is a sum). Fisher's -2 sum log p combines them: chi
/// squared with two degrees of freedom each.
struct LackOfFit {
  double f = 0.0;                          ///< mean of the ratios, weighted by degrees of freedom
  double degrees_of_freedom = 0.0;         ///< of the numerator
  double repeat_degrees_of_freedom = 0.0;  ///< of the denominator
  double p_value = 1.0;                    ///< probability of so large an F without lack of fit
  /// Share of the residuals' variance that a function a + b sin q + c cos q of each joint would explain.
  std::vector<double> explained_by_joint;
};

/// Empty without repeats. Of more than 2,000 configurations, 2,000 evenly spaced ones are used.
std::optional<LackOfFit> test_lack_of_fit(const ErrorModel& model, const Measurements& measurements,
                                          const Estimate& estimate, const Unknowns& free);

/// Residual vectors (measured mean minus predicted, in W) of every target of every training configuration: the share
/// explained by joint j is 1 - (residual sum of squares with a + b sin q_j + c cos q_j) / (total sum of squares).
std::vector<double> explained_by_joints(const ErrorModel& model, const Estimate& estimate,
                                        const Measurements& measurements);

}  // namespace kdl_calibration
