#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

struct RegistrationOptions {
  KnownFrames known;  ///< not estimated
  /// [m] an orientation error of 1 rad counts as this position error.
  double orientation_length = 0.3;
};

/// Poses of the base and the targets for a given geometry.
struct Registration {
  Frames frames;           ///< in the measurements' order; orientation of targets only if measured
  double rms = 0.0;        ///< [m] 3D distance between measured and predicted points
  int open = 0;            ///< undetermined directions of base and targets
  bool ambiguous = false;  ///< another base pose fits about as well
  std::string message;     ///< why it is ambiguous
};

/// Base and targets that minimise the weighted sum of squared 3D distances between the measured points and
/// X_WB X_BF(q) t, over the observations with Split::train. No starting values are needed.
/// `X_BF` holds one flange pose per configuration. Weights are 1/sigma^2, or 1 without a stated sigma.
///
/// With A = R_WB^T and c = A p_WB the residual A z - c - X_BF t is linear in (A, c, t). Eliminating c and all t leaves
/// a quadratic form in the nine elements of A, exact and independent of the number of observations, which is minimised
/// over the rotations from 25 starts (a rotation search as in Olsson et al. 2009, without its bounds). Measured
/// orientations add the terms A Z - R_BF R_FT with R_FT unconstrained, an approximation whose result lies within noise
/// of the optimum. With several stations or single coordinates see station_registration.hpp.
Registration register_base_and_targets(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements,
                                       const RegistrationOptions& options = {});

/// The 24 rotations of the cube: no rotation is farther than 62.8 degrees from one of them.
std::vector<Eigen::Matrix3d> cube_rotations();

/// [m] lower bound of the 3D RMS over all bases and targets: the minimum of that quadratic form over all matrices A
/// instead of rotations, at a tenth of the cost of a registration. Ignores sigmas and orientations.
double least_misfit(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements);

}  // namespace kdl_calibration
