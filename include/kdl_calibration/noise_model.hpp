#pragma once

// How measured points scatter.
//
//     CalibrationOptions options;
//     options.noise.stated.tracker = TrackerNoise{.range = 1e-5, .transverse = 1.5e-5, .transverse_per_metre = 6e-6};

#include <Eigen/Core>
#include <optional>

#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// 1 sigma of a tracker's distance and of its transverse error, each a constant plus a part that grows with distance.
/// The tracker is at the origin of W.
struct TrackerNoise {
  double range = 0.0;                 ///< [m]
  double range_per_metre = 0.0;       ///< [m/m]
  double transverse = 0.0;            ///< [m]
  double transverse_per_metre = 0.0;  ///< [m/m], i.e. [rad]
};

/// The covariance of the measurements. Observations with a stated sigma keep it for their independent part. One repeat
/// of a configuration with m points has the 3m x 3m block
///   blockdiag(independent parts) + common ⊗ (all ones).
/// Model misfit is the same in every repeat. It adds to the covariance of the means over the repeats
///   target_misfit^2 I + misfit^2 (all ones ⊗ I).
struct NoiseModel {
  /// [m] independent 1 sigma of every coordinate of a point, along the axes of W. Zero without tracker or common part:
  /// unknown, equal weights.
  Eigen::Vector3d independent = Eigen::Vector3d::Zero();
  std::optional<TrackerNoise> tracker;               ///< instead of `independent`
  Eigen::Vector3d common = Eigen::Vector3d::Zero();  ///< [m] shared by the points of one repeat, along the axes of W
  double misfit = 0.0;                               ///< [m] per coordinate, shared by the targets of a configuration
  double target_misfit = 0.0;                        ///< [m] per coordinate of each target in each configuration
  double orientation = 0.0;                          ///< [rad] of every component of a measured orientation

  bool is_absolute() const { return tracker.has_value() || !independent.isZero(0.0) || !common.isZero(0.0); }
  bool has_misfit() const { return misfit != 0.0 || target_misfit != 0.0; }
  /// Whether all parts are isotropic, the common one included.
  bool is_alike_in_every_direction() const;
  /// Whether points are independent of each other and isotropic.
  bool is_isotropic() const;
};

/// Robust loss, which reduces the weight of large residuals. With r the whitened 3D residual of a point's position over
/// its scale, the weight is 1 (none), min(1, 2.5/r) (Huber 1964) or (1 - (r/7)^2)^2 below r = 7 and 0 beyond (Beaton
/// and Tukey 1974). The constants leave more than 95 % of the information of clean normal data in three dimensions.
enum class Loss { none, huber, tukey };

}  // namespace kdl_calibration
