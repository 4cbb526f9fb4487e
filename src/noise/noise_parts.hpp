#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <string>
#include <vector>

#include "estimation/identification.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/prediction.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

/// The parts of the noise as variances, with their uncertainty:
///   measured = predicted + misfit of the configuration (shared by its targets, the same in every repeat)
///            + misfit of configuration x target + part common to the points of a repeat + part of each point.
/// Parts that the measurements cannot separate are merged. Without repeats the common part counts as misfit, and the
/// misfit of configuration x target as part of the point. If no configuration has two targets, the misfit counts as
/// that of configuration x target.
struct NoiseParts {
  /// Indices of the parts.
  static constexpr Eigen::Index kMisfit = 0;
  static constexpr Eigen::Index kTargetMisfit = 1;
  static constexpr Eigen::Index kCommon = 2;       ///< along x, y and z of W
  static constexpr Eigen::Index kIndependent = 5;  ///< along x, y and z of W
  static constexpr Eigen::Index kOrientation = 8;
  static constexpr Eigen::Index kCount = 9;
  /// One per part [m^2], of the orientation [rad^2].
  using Variances = Eigen::Matrix<double, kCount, 1>;
  Variances variances = Variances::Zero();
  Eigen::Matrix<double, kCount, kCount> covariance =
      Eigen::Matrix<double, kCount, kCount>::Zero();  ///< of the variances; zero for stated or vanishing parts
  std::array<bool, kCount> estimated = {};            ///< false: stated or merged

  /// For each part d(scatter of the gradient) / d(variance), columns x columns; empty if not estimated. The covariance
  /// of the columns changes by B sensitivity_k B, with B the inverse of the weighted information.
  std::vector<Eigen::MatrixXd> sensitivity;
  /// Scatter of the gradient if the rows are not weighted by these parts: the covariance of the columns is B scatter B.
  /// Otherwise empty, and the covariance is B.
  Eigen::MatrixXd scatter;
  /// Residual degrees of freedom of positions behind the estimates, all parts together.
  double degrees_of_freedom = 0.0;
  /// Equations minus unknowns, orientations included: upper bound for any estimate.
  double residual_degrees_of_freedom = std::numeric_limits<double>::infinity();
  bool converged = false;

  bool estimates_misfit() const { return estimated[kMisfit] || estimated[kTargetMisfit]; }
  double misfit() const { return variances[kMisfit]; }
  double target_misfit() const { return variances[kTargetMisfit]; }
  Eigen::Vector3d common() const { return variances.segment<3>(kCommon); }
  Eigen::Vector3d independent() const { return variances.segment<3>(kIndependent); }

  /// Noise model of a fit with these parts; stated ones as in `stated`, the independent part never zero.
  NoiseModel model(const NoiseModel& stated) const;
  /// Covariance [m^2] in W of a measured point about its prediction by the true parameters, without stated row or
  /// tracker noise.
  Eigen::Matrix3d point() const;
  /// Satterthwaite's degrees of freedom of a variance `value` with this gradient by the parts' variances: 2 value^2 /
  /// its variance, at most `residual_degrees_of_freedom`. Infinite if no estimated part enters.
  double freedom(double value, const Variances& gradient) const;
  /// Those of the trace of point().
  double freedom_of_point() const;
};

/// Restricted maximum likelihood of the parts that are not stated (Patterson and Thompson 1971; Harville 1977), at the
/// linearised solution about `estimate`. It uses the information of the targets' means and of the deviations from them,
/// summed once. Of more than 2,000 configurations, 2,000 evenly spaced ones are used. A part with less than half a
/// residual degree of freedom is set to zero: its likelihood is flat.
/// With stated point noise a misfit is estimated only if the residuals exceed that noise with p < 0.05. Otherwise it
/// would be biased upwards, because a variance cannot be negative. If no part is left to estimate, `converged` is
/// false.
/// `options`: noise and priors as stated. Not for robust losses; row weights are used.
NoiseParts estimate_noise(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                          const Unknowns& free, const ResidualOptions& options);

/// The factors of the stations' noise, one pair for each station: on the stated noise, else relative to the smallest.
/// Restricted maximum likelihood of one variance for each station beside the misfits, from rows with the same weights.
/// Empty if one variance for all is as likely (likelihood ratio, p > 0.001) or cannot be told from them.
std::vector<NoiseFactors> noise_by_station(const FitProblem& fit, const NoiseModel& stated);

/// The parts that are not stated, from residuals of a fit with other weights: squared residuals are compared with their
/// expectation (minimum norm quadratic unbiased estimation, Rao 1971). `fit`: at its optimum; `stated`: noise not to be
/// estimated; `misfits`: whether to estimate misfits.
NoiseParts noise_beside_weights(const FitProblem& fit, const NoiseModel& stated, bool misfits);

}  // namespace kdl_calibration
