#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

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
