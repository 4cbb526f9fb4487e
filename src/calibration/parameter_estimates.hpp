#pragma once

#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "calibration/determined_fit.hpp"

namespace kdl_calibration {

/// Uncertainty of a fit's columns. Keeps references.
struct KnownOfParameters {
  const std::vector<std::string>& fixed_by_gauge;
  const std::vector<std::vector<std::string>>& tied;  ///< groups that the measurements cannot tell apart
  const Eigen::MatrixXd& covariance;                  ///< of the columns
  const NoiseReport& noise;
};

/// Every parameter that was estimated, is held by a gauge, or has a value that is not zero, with its uncertainty from
/// the covariance of the columns. Nominal values of base and targets are those registered to the nominal arm.
std::vector<ParameterEstimate> parameter_estimates(const ErrorModel& model, const Estimate& nominal,
                                                   const DeterminedFit& fit, const KnownOfParameters& known);

/// Whether the uncertainty exceeds any useful size: the link for a length, 0.5 rad for an angle.
bool is_unknown(const ErrorModel& model, const ParameterEstimate& estimate);

/// Half the width of the 95 % interval of Student's t.
double half_width_95(double std, double degrees_of_freedom);

}  // namespace kdl_calibration
