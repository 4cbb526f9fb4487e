#pragma once

#include <Eigen/Core>
#include <optional>

#include "calibration/noise_stage.hpp"
#include "calibration/whole_fit.hpp"
#include "kdl_calibration/calibration.hpp"

namespace kdl_calibration {

/// p-value below which a misfit counts as more than noise.
constexpr double kMisfitCertain = 1e-3;

/// Throws InputError where there are no repeats, or none that vary along every axis.
void require_repeats(const Measurements& measurements);

/// Throws InputError for a sigma of orientations [rad] that has no sigma of positions [m] beside it, or no orientation.
void require_comparable_orientations(const Measurements& measurements, const CalibrationOptions& options);

/// Whether the noise is known before the fit: stated for all rows or for some.
bool noise_is_stated(const Measurements& measurements, const CalibrationOptions& options);

/// Priors and residuals must be on one scale. Where nothing states the noise, the residuals of the fit without priors
/// do, the drift and the misfit of the model included.
void make_absolute(const FitTask& task, const Unknowns& free, FitOptions& options);

struct NoiseAssessment {
  NoiseReport report;
  Eigen::MatrixXd covariance;  ///< of the columns
};

/// The covariance of the columns over the one that the weights of this system promise, as a mean over what was
/// measured; 1 where something is not determined.
double variance_of_unit_weight(const Eigen::MatrixXd& triangle, const Eigen::MatrixXd& covariance);

/// The end of a fit. Keeps references.
struct FittedSystem {
  const LeastSquaresProblem& problem;
  const Estimate& estimate;
  const Unknowns& free;
  const WhitenedSummary& system;
  const std::vector<double>& row_weights;
  int rank;  ///< how many of the columns the system determines
};

/// Noise and covariance at the end of a fit.
NoiseAssessment assess_noise(const FitTask& task, const FittedSystem& fitted, const RobustRows& robust,
                             const EstimatedNoise& estimated);

/// The residuals of a fit against the scatter of the repeats; none where there are no repeats.
std::optional<LackOfFit> lack_of_fit(const FitTask& task, const Estimate& estimate, const Unknowns& free);

}  // namespace kdl_calibration
