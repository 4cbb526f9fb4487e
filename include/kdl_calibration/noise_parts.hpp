#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <string>
#include <vector>

#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/prediction.hpp"

namespace kdl_calibration {

/// The parts of the noise as variances, and how well they are known:
///   measured = predicted + misfit of the configuration (shared by its targets, the same in every repeat)
///            + misfit of configuration x target + part common to the points of a repeat + part of each point.
/// Where the measurements cannot separate two of them they are one: without repeats the common part counts as misfit
/// and the misfit of configuration x target as part of the point; where no configuration has two targets the misfit is
/// that of configuration x target.
struct NoiseParts {
  /// Places of the parts.
  static constexpr Eigen::Index kMisfit = 0;
  static constexpr Eigen::Index kTargetMisfit = 1;
  static constexpr Eigen::Index kCommon = 2;       ///< along x, y and z of W
  static constexpr Eigen::Index kIndependent = 5;  ///< along x, y and z of W
  static constexpr Eigen::Index kOrientation = 8;
  static constexpr Eigen::Index kCount = 9;
  /// Of each part [m^2], of the orientation [rad^2].
  using Variances = Eigen::Matrix<double, kCount, 1>;
  Variances variances = Variances::Zero();
  Eigen::Matrix<double, kCount, kCount> covariance =
      Eigen::Matrix<double, kCount, kCount>::Zero();  ///< of the variances; zero where one is stated or vanishes
  std::array<bool, kCount> estimated = {};            ///< the others are stated or one with another

  /// Of each part: d(scatter of the gradient) / d(variance), so that the covariance of the columns changes by
  /// B sensitivity_k B, B the inverse of the information by which the rows are weighed. Columns x columns; empty where
  /// the part is not estimated.
  std::vector<Eigen::MatrixXd> sensitivity;
  /// Where the rows are not weighed by these parts: the scatter of the gradient, so that the covariance of the columns
  /// is B scatter B. Empty otherwise: the covariance is B.
  Eigen::MatrixXd scatter;
  /// Residual degrees of freedom on which the estimates rest, of positions, all parts together.
  double degrees_of_freedom = 0.0;
  /// Equations less unknowns, orientations included: no estimate rests on more.
  double residual_degrees_of_freedom = std::numeric_limits<double>::infinity();
  bool converged = false;

  bool estimates_misfit() const { return estimated[kMisfit] || estimated[kTargetMisfit]; }
  double misfit() const { return variances[kMisfit]; }
  double target_misfit() const { return variances[kTargetMisfit]; }
  Eigen::Vector3d common() const { return variances.segment<3>(kCommon); }
  Eigen::Vector3d independent() const { return variances.segment<3>(kIndependent); }

  /// For the fit: the same weights, whatever the measurements could not separate.
  NoiseModel model(const NoiseModel& stated) const;
  /// Covariance [m^2] in W of one measured point about its prediction by the true parameters, where nothing is stated
  /// by row or tracker.
  Eigen::Matrix3d point() const;
  /// Satterthwaite's degrees of freedom of an estimated variance with this gradient by the parts' variances: 2 value^2
  /// over its variance, at most `residual_degrees_of_freedom`; infinite where no estimated part enters.
  double freedom(double value, const Variances& gradient) const;
  /// Those of the trace of point().
  double freedom_of_point() const;
};

/// Restricted maximum likelihood of the parts that nobody stated (Patterson and Thompson 1971; Harville 1977), at the
/// linearised solution about `estimate`. It needs of the measurements the information of the targets' means and of
/// their deviations from them, summed once; more than 2,000 configurations are represented by as many evenly spaced
/// ones. A part of which the fit leaves less than half a degree of freedom is zero: its likelihood is flat.
/// Where the noise of the points is stated a misfit is estimated only if the residuals are above what is stated, with
/// p < 0.05: a variance cannot be negative, and what is estimated on top of the true noise would be too much. Nothing
/// may be left to estimate then; `converged` is false.
/// `options`: noise and priors as stated. Not for a loss: rows count with their weights.
NoiseParts estimate_noise(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                          const Unknowns& free, const ResidualOptions& options);

/// The parts that nobody stated, as the residuals of a fit show them whose rows are weighed by something else: squares
/// of these residuals against what they are expected to be (minimum norm quadratic unbiased estimation, Rao 1971, with
/// these weights). `fit`: at its optimum; `stated`: the noise that is not to be estimated; `misfits`: whether those
/// are.
NoiseParts noise_beside_weights(const FitProblem& fit, const NoiseModel& stated, bool misfits);

}  // namespace kdl_calibration
