#pragma once

// Not installed.

#include <optional>

#include "calibration/determined_fit.hpp"
#include "kdl_calibration/noise_parts.hpp"

namespace kdl_calibration {

/// What is known of the noise beforehand.
struct NoiseBeforehand {
  NoiseModel stated;
  bool estimated = true;  ///< whether parts that are not stated are estimated
};

/// The end of a fit with estimated noise.
struct EstimatedNoise {
  std::optional<NoiseParts> parts;
  ResidualOptions as_stated;  ///< what the rows were whitened with before
  NoiseModel weights;         ///< what they are whitened with at `estimate`
  Estimate estimate;
};

/// Estimates the parts of the noise that nobody stated at an optimum, the start of `problem`, and fits its unknowns
/// again with the weights that follow. Where these weights predict left-out configurations worse the estimate and its
/// weights stay, and the parts are those that its residuals show. Nothing is estimated where `noise` says so, and where
/// the residuals are rounding. `rms`: [m] of the fit.
EstimatedNoise fit_with_estimated_noise(const FitProblem& problem, const NoiseBeforehand& noise, double rms);

/// The same for a selection between models: the weights by the parts at the fit of the problem without priors. None
/// where they are not to be estimated, or could not be.
std::optional<NoiseModel> weights_by_estimated_noise(const FitProblem& problem, const NoiseBeforehand& noise);

/// The problem's options, with weights that priors can be compared with: those weights or, where nothing states the
/// noise, a sigma for all rows by the residuals.
FitOptions absolute_weights(const FitProblem& problem, const NoiseBeforehand& noise);

/// Weights until the parts are estimated, where the mean of a point's repeats is off by `sigma` [m]: that, or the
/// stated noise, and a misfit beside it where it is to be estimated and the rest is clearly larger.
NoiseModel noise_of_means(const Measurements& measurements, const NoiseBeforehand& beforehand, double sigma);

/// 1 sigma of a printed value and the degrees of freedom that it rests on.
struct ValueUncertainty {
  double std = 0.0;
  double degrees_of_freedom = 0.0;
};

/// Of every free column, in their order, for the values as they are printed: the place of the base and the rotation
/// vectors of base and targets in W and in the flange frame, although their columns are motions in frames of their own.
/// `covariance`: of the columns.
std::vector<ValueUncertainty> uncertainties(const Estimate& estimate, const Unknowns& free,
                                            const Eigen::MatrixXd& covariance, const NoiseReport& noise);

}  // namespace kdl_calibration
