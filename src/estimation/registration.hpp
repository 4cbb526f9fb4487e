#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "estimation/residual_options.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

struct RegistrationOptions {
  KnownFrames known;  ///< not estimated
  /// [m] an orientation error of 1 rad counts as this position error.
  double orientation_length = kOrientationLength;
};

/// Poses of the base and the targets for a given geometry.
struct Registration {
  Frames frames;           ///< in the measurements' order; orientation of targets only if measured
  double rms = 0.0;        ///< [m] measured minus predicted, along the measured directions
  int undetermined = 0;    ///< number of directions of base and targets
  bool ambiguous = false;  ///< another base pose fits about as well
  std::string message;     ///< why it is ambiguous
};

/// The base of each station and the targets that they share. They minimise the weighted sum of squared residuals of the
/// readings (see `residual`) over the observations with Split::train: of points, the 3D distances between the measured
/// ones and X_WB X_BF(q) t. No starting values are needed. `X_BF` holds one flange pose per configuration. Weights are
/// 1/sigma^2, or 1 without a stated sigma.
///
/// A station is registered by itself and determines its targets; the others follow in the order of their rows, with the
/// targets known. From there all bases and targets are fitted together by Levenberg-Marquardt steps. If the first
/// station does not determine its base and targets, further ones are tried as the first, and the best fit is taken.
/// Directions that no row determines stay as they were registered. A station of whole points is registered in closed
/// form (`point_registration`), others by steps from several starts (`joint_registration`).
Registration register_base_and_targets(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements,
                                       const RegistrationOptions& options = {});

}  // namespace kdl_calibration
