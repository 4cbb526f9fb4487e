#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

struct RegistrationOptions {
  std::optional<Eigen::Isometry3d> known_base;  ///< X_WB
  std::vector<TargetFrame> known_targets;       ///< those with a name of the measurements are not estimated
  /// [m] error of an orientation by one radian counts as much as this error of position.
  double orientation_length = 0.3;
};

/// Where the robot's base and the targets are, for a given geometry.
struct Registration {
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();
  std::vector<TargetFrame> targets;  ///< in the measurements' order; orientation only where it was measured
  double rms = 0.0;                  ///< [m] 3D distance between measured and predicted points
  int open = 0;                      ///< directions of base and targets that the measurements leave undetermined
  bool ambiguous = false;            ///< another pose of the base explains the measurements about as well
  std::string message;               ///< why it is ambiguous
};

/// Base and targets that minimise the weighted sum of squared 3D distances between the measured points and
/// X_WB X_BF(q) t, over the observations with Split::train, with no starting values: base and targets anywhere.
/// `X_BF` holds one flange pose per configuration. Observations weigh 1/sigma^2, or 1 where no sigma is stated.
///
/// With A = R_WB^T and c = A p_WB the residual A z - c - X_BF t is linear in (A, c, t). Eliminating c and all t leaves
/// a quadratic form in the nine elements of A, exact and independent of the number of observations, which is
/// minimised over the rotations from 25 starts (a rotation search as in Olsson et al. 2009, without its bounds).
/// Measured orientations add the terms A Z - R_BF R_FT with R_FT free, an approximation that leaves a start within
/// noise of the optimum.
Registration register_base_and_targets(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements,
                                       const RegistrationOptions& options = {});

/// [m] 3D RMS of these observations that no base and no targets can leave less than: that of the quadratic form above
/// over all matrices A instead of the rotations, by linear least squares, a tenth of a registration's work. No sigmas,
/// no orientations.
double least_misfit(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements);

}  // namespace kdl_calibration
