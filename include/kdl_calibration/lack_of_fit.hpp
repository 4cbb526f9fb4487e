#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "kdl_calibration/least_squares.hpp"

namespace kdl_calibration {

/// Lack of fit: what is left of the means and of the targets' deviations from them, at the weighted solution, against
/// the scatter of the repeats. Along each axis of W and for each of both the ratio
///   F = (squares left / their degrees of freedom) / variance by the repeats
/// follows the F distribution if geometry explains all but noise (Draper and Smith, Applied Regression Analysis, lack
/// of fit; Satterthwaite's degrees of freedom where the variance is a sum), and Fisher's -2 sum log p chi squared with
/// two degrees of freedom for each.
struct LackOfFit {
  double f = 0.0;                          ///< mean of the ratios, by their degrees of freedom
  double degrees_of_freedom = 0.0;         ///< of the numerator
  double repeat_degrees_of_freedom = 0.0;  ///< of the denominator
  double p_value = 1.0;                    ///< chance of an F as large if geometry explained everything
  /// Share of the residuals' variance that a function a + b sin q + c cos q of each joint would explain.
  std::vector<double> explained_by_joint;
};

/// Without repeats there is none. More than 2,000 configurations are represented by as many evenly spaced ones.
std::optional<LackOfFit> test_lack_of_fit(const ErrorModel& model, const Measurements& measurements,
                                          const Estimate& estimate, const Unknowns& free);

/// Residual vectors (measured mean minus predicted, in W) of every target of every training configuration, explained
/// by each joint: entry j is 1 - (residual sum of squares with a + b sin q_j + c cos q_j) / (total sum of squares).
std::vector<double> explained_by_joints(const ErrorModel& model, const Estimate& estimate,
                                        const Measurements& measurements);

}  // namespace kdl_calibration
