#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

/// 1 sigma of a tracker's distance and of its transverse error, each a constant plus a part that grows with distance.
/// The measuring frame is the tracker's own: it stands at the origin.
struct TrackerNoise {
  double range = 0.0;                 ///< [m]
  double range_per_metre = 0.0;       ///< [m/m]
  double transverse = 0.0;            ///< [m]
  double transverse_per_metre = 0.0;  ///< [m/m], i.e. [rad]
};

/// The covariance of what was measured. Observations with a sigma of their own keep it for their independent part.
/// Of one repeat of a configuration, with m points, it is the 3m x 3m block
///   blockdiag(independent parts) + common ⊗ (all ones).
/// What the model misses is the same in every repeat: to the covariance of the means over the repeats it adds
///   target_misfit^2 I + misfit^2 (all ones ⊗ I).
struct NoiseModel {
  /// [m] 1 sigma of every coordinate of a point by itself, along the axes of W. Zero, without tracker or common part,
  /// means that only the proportions are known: all rows weigh alike.
  Eigen::Vector3d independent = Eigen::Vector3d::Zero();
  std::optional<TrackerNoise> tracker;               ///< instead of `independent`
  Eigen::Vector3d common = Eigen::Vector3d::Zero();  ///< [m] shared by the points of one repeat, along the axes of W
  double misfit = 0.0;                               ///< [m] per coordinate, shared by the targets of a configuration
  double target_misfit = 0.0;                        ///< [m] per coordinate of each target in each configuration
  double orientation = 0.0;                          ///< [rad] of every component of a measured orientation

  bool is_absolute() const { return tracker.has_value() || !independent.isZero(0.0) || !common.isZero(0.0); }
  bool has_misfit() const { return misfit != 0.0 || target_misfit != 0.0; }
  /// Whether errors are alike in every direction, whatever points share.
  bool is_alike_in_every_direction() const;
  /// Whether points are independent of each other and alike in every direction.
  bool is_isotropic() const;
};

/// Covariance of one measured point by itself, along the axes of W [m^2]; zero where nothing is stated.
Eigen::Matrix3d point_covariance(const NoiseModel& noise, const Observation& observation);

/// How residuals are weighed.
struct ResidualOptions {
  Priors priors;
  NoiseModel noise;
  std::vector<double> row_weights;  ///< factor on the information of each observation, 0 leaves it out; empty: all 1
  /// [m] where orientations have no sigma: an error of one radian counts as much as this error of position.
  double orientation_length = 0.3;
  int threads = 1;  ///< of a pass over many configurations, 0: one per core; its figures do not depend on it

  double row_weight(std::size_t row) const { return row_weights.empty() ? 1.0 : row_weights[row]; }
};

/// Information of a coordinate of a point where the noise is isotropic [1/m^2], without its row's weight; 1 where
/// nothing is stated.
double position_information(const ResidualOptions& options, const Observation& observation);
/// Information of a component of an orientation whose position has `position_information`.
double orientation_information(const ResidualOptions& options, double position_information);

}  // namespace kdl_calibration
