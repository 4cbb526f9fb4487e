#pragma once

#include <optional>

#include "calibration/determined_fit.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "noise/noise_parts.hpp"

namespace kdl_calibration {

/// Prior knowledge of the noise.
struct NoiseBeforehand {
  NoiseModel stated;
  bool estimated = true;  ///< whether parts that are not stated are estimated
};

/// Result of a fit with estimated noise.
struct EstimatedNoise {
  std::optional<NoiseParts> parts;
  ResidualOptions as_stated;  ///< weights before the estimation
  NoiseModel weights;         ///< weights of `estimate`
  Estimate estimate;
};

/// Estimates the unstated parts of the noise at an optimum, the start of `problem`, and fits again with the resulting
/// weights. If these predict left-out configurations worse, estimate and weights are kept, and the parts come from the
/// residuals. Nothing is estimated if `noise` forbids it or the residuals are rounding. `rms`: [m] of the fit.
EstimatedNoise fit_with_estimated_noise(const FitProblem& problem, const NoiseBeforehand& noise, double rms);

/// The same for model selection: weights from the parts at the fit without priors. Empty if they are not, or cannot be,
/// estimated.
std::optional<NoiseModel> weights_by_estimated_noise(const FitProblem& problem, const NoiseBeforehand& noise);

/// The problem's options with absolute weights, as priors require: those weights or, if no noise is stated, one sigma
/// for all rows from the residuals.
FitOptions absolute_weights(const FitProblem& problem, const NoiseBeforehand& noise);

/// Weights until the parts are estimated: `sigma` [m], the 1 sigma of the means of repeats, or the stated noise. A
/// misfit is added if it is to be estimated and `sigma` is clearly larger.
NoiseModel noise_of_means(const Measurements& measurements, const NoiseBeforehand& beforehand, double sigma);

/// 1 sigma of a printed value and its degrees of freedom.
struct ValueUncertainty {
  double std = 0.0;
  double degrees_of_freedom = 0.0;
};

/// Uncertainties of the printed values, one per free column: the base in W and targets in the flange frame, by position
/// and rotation vector, although their columns are motions in their own frames. `covariance`: of the columns.
std::vector<ValueUncertainty> uncertainties(const Estimate& estimate, const Unknowns& free,
                                            const Eigen::MatrixXd& covariance, const NoiseReport& noise);

}  // namespace kdl_calibration
