#pragma once

// Not installed.

#include <Eigen/Core>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/fold_prediction.hpp"

namespace kdl_calibration {

/// A future measurement of the same kind as the existing ones.
struct NewPoint {
  double radius_95 = 0.0;           ///< [m] of the sphere about the prediction; infinite if not determined
  double degrees_of_freedom = 0.0;  ///< of the variance of a single point
};

struct PointPrediction {
  Eigen::Matrix3d covariance;  ///< [m^2] in W, of the parameters alone
  Eigen::Vector3d place;       ///< [m] in W
  double repeats = 1.0;        ///< number of repeats that the measurement averages
};

/// With S the covariance of one measured point, misfit included, Sigma = covariance + S, s^2 = tr Sigma and k = s^4 /
/// tr Sigma^2, the squared error over s^2 is about F with k and nu degrees of freedom (Satterthwaite 1946, Box 1954),
/// nu those of tr S: radius s sqrt(F_0.95(k, nu)).
NewPoint new_point(const PointPrediction& prediction, const NoiseReport& noise);

/// The region where the predicted radii hold, and their factor.
struct MeasuredRegion {
  /// The radii's factor: the smallest one for which 95 % of n + 1 held-out configurations lie within the radii
  /// predicted without them (conformal prediction, Lei et al. 2018; each counts with the share of its targets). Below
  /// 40 configurations it is the optimism of the model selection.
  double radius_factor = 1.0;
  double largest_variance = 0.0;  ///< [m^2] trace of the covariance of a held-out point by the parameters
  JointRanges joints;             ///< of the training rows, and 5 % beyond on both sides

  bool holds(const Eigen::VectorXd& q, const Eigen::Matrix3d& of_parameters) const;
};
MeasuredRegion measured_region(const Measurements& measurements, const std::vector<HeldOutPoint>& held_out,
                               const NoiseReport& noise, double optimism);

}  // namespace kdl_calibration
