#pragma once

#include <string>

#include "cli/frames.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration::cli {

/// Where the published matrices are wanted: at which parameters, for which of them, in which configurations.
struct IdentificationAt {
  ErrorModel model;
  Estimate estimate;
  Unknowns free;
  std::vector<std::string> configurations;  ///< labels
  Eigen::MatrixXd joint_values;             ///< joints x configurations
};

/// One row for each coordinate of each target in each configuration: the identification Jacobian's columns under their
/// parameters' names, then those of A.
std::string identification_csv(const IdentificationAt& at);
Json identification_json(const IdentificationAt& at);

}  // namespace kdl_calibration::cli
