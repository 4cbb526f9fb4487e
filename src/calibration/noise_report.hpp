#pragma once

#include <Eigen/Core>
#include <optional>

#include "calibration/whole_fit.hpp"
#include "kdl_calibration/calibration.hpp"

namespace kdl_calibration {

/// p-value below which a misfit counts as more than noise.
constexpr double kMisfitCertain = 1e-3;

/// The noise that the rows are whitened with: as stated, or from the repeats. Throws InputError where those do not
/// tell it.
NoiseModel noise_model(const Measurements& measurements, const CalibrationOptions& options);

/// Throws InputError for a sigma of orientations [rad] that has no sigma of positions [m] beside it, or no orientation.
void require_comparable_orientations(const Measurements& measurements, const CalibrationOptions& options);

/// Whether the noise is known before the fit: stated for all rows or for some, or taken from the repeats.
bool noise_is_stated(const Measurements& measurements, const CalibrationOptions& options);

/// Priors and residuals must be on one scale. Where nothing states the noise, the residuals of the fit without priors
/// do, the drift and the misfit of the model included.
void make_absolute(const FitTask& task, const FreeParameters& free, FitOptions& options);

struct NoiseAssessment {
  NoiseReport report;
  Eigen::MatrixXd covariance;  ///< of the columns
};

/// Noise and covariance at the end of a fit. `rank`: how many of the columns the system determines.
NoiseAssessment assess_noise(const FitTask& task, const LeastSquaresProblem& problem, const Estimate& estimate,
                             const WhitenedSummary& system, int rank);

/// The residuals of a fit against the scatter of the repeats; none where there are no repeats.
std::optional<LackOfFit> lack_of_fit(const FitTask& task, const Estimate& estimate, const FreeParameters& free);

}  // namespace kdl_calibration
