#pragma once

#include <Eigen/Core>

#include "estimation/least_squares.hpp"

namespace kdl_calibration {

/// Variance components of the training rows from their repeats (analysis of variance with targets of one repeat as
/// correlated measurements): per axis of W, `common` is the mean covariance of two targets of one repeat, `independent`
/// the remaining variance. If no configuration has two targets with repeats, the two are not separable and all counts
/// as independent.
struct RepeatNoise {
  Eigen::Vector3d independent = Eigen::Vector3d::Zero();  ///< [m] 1 sigma
  Eigen::Vector3d common = Eigen::Vector3d::Zero();       ///< [m] 1 sigma
  Eigen::Vector3d total = Eigen::Vector3d::Zero();        ///< [m] 1 sigma
  double degrees_of_freedom = 0.0;                        ///< per axis; 0: there are no repeats
  bool separable = false;
  double orientation = 0.0;  ///< [rad] 1 sigma of a component of measured orientations; 0 without repeats
  double orientation_degrees_of_freedom = 0.0;  ///< per component
};
RepeatNoise noise_from_repeats(const Measurements& measurements);

/// Variance components of the residuals of a fit with equal weights, pooled over the axes: `common` is shared by the
/// points of one configuration (drift and model misfit), `independent` is the rest. Both are corrected for the degrees
/// of freedom used by the fit.
struct ResidualNoise {
  double independent = 0.0;  ///< [m] 1 sigma of a coordinate
  double common = 0.0;       ///< [m] 1 sigma of a coordinate
  double degrees_of_freedom = 0.0;
  double total() const;
};
ResidualNoise noise_from_residuals(const WhitenedSummary& summary, int rank, double unit_weight);

}  // namespace kdl_calibration
