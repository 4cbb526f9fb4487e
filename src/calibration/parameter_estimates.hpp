#pragma once

#include <string>
#include <vector>

#include "calibration/whole_fit.hpp"
#include "kdl_calibration/calibration.hpp"

namespace kdl_calibration {

/// Every parameter that was estimated, is held by a gauge, or has a value that is not zero, with its uncertainty by
/// the covariance of the columns. What is nominal of base and targets is where they are registered to the nominal arm.
std::vector<ParameterEstimate> parameter_estimates(const FitTask& task, const WholeFit& fit,
                                                   const std::vector<std::string>& fixed_by_gauge,
                                                   const Eigen::MatrixXd& covariance);

/// Whether the uncertainty is so large that nothing is known: a length to more than its link, an angle to half a
/// radian.
bool is_unknown(const ErrorModel& model, const ParameterEstimate& estimate);

/// Half the width of the 95 % interval of a normal value with this 1 sigma.
double half_width_95(double std);

}  // namespace kdl_calibration
