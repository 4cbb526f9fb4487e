#pragma once

// Not installed.

#include <optional>

#include "calibration/whole_fit.hpp"
#include "kdl_calibration/noise_parts.hpp"

namespace kdl_calibration {

struct EstimatedNoise {
  std::optional<NoiseParts> parts;
  ResidualOptions as_stated;  ///< what the rows were whitened with before
};

/// Estimates the parts of the noise that nobody stated at the end of `fit`, and fits the same parameters again with the
/// weights that follow. `residuals`, those of the task's options, get these weights. Where these weights predict
/// left-out configurations worse the fit stays, and the parts are those that its residuals show. Nothing happens, and
/// nothing is estimated, where plain least squares were asked for, where rows are down-weighted, and where the fit did
/// not arrive.
EstimatedNoise fit_with_estimated_noise(const FitTask& task, WholeFit& fit, ResidualOptions& residuals);

/// The same for a choice between models: the parts at the fit of `free` without priors, from the task's start. False
/// where they are not to be estimated, or could not be; `residuals` is left as it was then.
bool weigh_by_estimated_noise(const FitTask& task, const Unknowns& free, ResidualOptions& residuals);

/// Weights until the parts are estimated, where the mean of a point's repeats is off by `sigma` [m]: that, or the
/// stated noise, and a misfit beside it where it is to be estimated and the rest is clearly larger.
NoiseModel noise_of_means(const Measurements& measurements, const CalibrationOptions& options, double sigma);

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
