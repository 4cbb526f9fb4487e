#pragma once

#include "calibration/calibration_result.hpp"

namespace kdl_calibration {

/// Ratio of the estimates' size to that expected by the priors; 1 if consistent with them. With P the priors'
/// covariance and C that of the estimates x, x has covariance P - C if the errors were drawn from the priors: the sum
/// of x_i^2 / P_ii has the expectation k = sum of (1 - C_ii / P_ii) and is about chi-squared with k degrees of freedom,
/// consistent if its p-value is above 0.001.
double excess_over_priors(const CalibrationResult& found);

}  // namespace kdl_calibration
