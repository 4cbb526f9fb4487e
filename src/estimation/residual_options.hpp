#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

/// Independent part of a measured point's covariance, along the axes of W [m^2]; zero if none is stated.
Eigen::Matrix3d point_covariance(const NoiseModel& noise, const Observation& observation);

/// Weights and priors of the residuals.
struct ResidualOptions {
  Priors priors;
  NoiseModel noise;
  std::vector<double> row_weights;  ///< factor on the information of each observation, 0 leaves it out; empty: all 1
  /// [m] for orientations without sigma: an error of 1 rad counts as this position error.
  double orientation_length = 0.3;
  int threads = 1;  ///< of a pass over the data, 0: one per core; the result does not depend on it

  double row_weight(std::size_t row) const { return row_weights.empty() ? 1.0 : row_weights[row]; }
};

/// Information of a point's coordinate under isotropic noise [1/m^2], without the row weight; 1 if no noise is stated.
double position_information(const ResidualOptions& options, const Observation& observation);
/// Information of an orientation component [1/rad^2], given that of its position.
double orientation_information(const ResidualOptions& options, double position_information);

}  // namespace kdl_calibration
