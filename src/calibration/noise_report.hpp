#pragma once

#include <Eigen/Core>
#include <optional>

#include "calibration/determined_fit.hpp"
#include "calibration/noise_stage.hpp"
#include "kdl_calibration/calibration.hpp"

namespace kdl_calibration {

/// p-value below which a misfit counts as more than noise.
constexpr double kMisfitCertain = 1e-3;

/// Whether the noise is known before the fit: stated for all rows or for some.
bool noise_is_stated(const Measurements& measurements, const NoiseModel& stated);

/// [m] 1 sigma of a coordinate by the residuals of the fit without priors, the drift and the misfit of the
/// model included. Priors and residuals must be on one scale where nothing states the noise.
double sigma_of_residuals(const FitProblem& fit);

struct NoiseAssessment {
  NoiseReport report;
  Eigen::MatrixXd covariance;  ///< of the columns
};

/// Variance of unit weight: tr(R C R^T) / number of columns, with R the square-root information and C the covariance.
/// Predictions of folds scale their covariances by it. 1 if a column is not determined.
double variance_of_unit_weight(const Eigen::MatrixXd& sqrt_information, const Eigen::MatrixXd& covariance);

/// The end of a fit. Keeps references.
struct FittedSystem {
  const LeastSquaresProblem& problem;
  const Estimate& estimate;
  const Unknowns& free;
  const WhitenedSummary& system;
  const std::vector<double>& row_weights;
  int rank;  ///< how many of the columns the system determines
};

/// Noise and covariance at the end of a fit, whose estimate and unknowns `fitted` has. `fit` says how rows are weighed.
NoiseAssessment assess_noise(const FittedSystem& fitted, const FitProblem& fit, const NoiseModel& stated,
                             const RobustRows& robust, const EstimatedNoise& estimated);

/// The residuals of an estimate against the scatter of the repeats; none where there are no repeats.
std::optional<LackOfFit> lack_of_fit(const ErrorModel& model, const Measurements& measurements,
                                     const Estimate& estimate, const Unknowns& free);

}  // namespace kdl_calibration
