#pragma once

#include <string>

#include "cli/frames.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration::cli {

/// Parameters and configurations at which to evaluate the published matrices.
struct IdentificationAt {
  ErrorModel model;
  Estimate estimate;
  Unknowns free;
  std::vector<std::string> configurations;  ///< labels
  Eigen::MatrixXd joint_values;             ///< joints x configurations
};

/// One row for each coordinate of each target in each configuration: the columns of the identification Jacobian, named
/// after the parameters, then those of A.
std::string identification_csv(const IdentificationAt& at);
Json identification_json(const IdentificationAt& at);

}  // namespace kdl_calibration::cli
