#pragma once

#include <Eigen/Core>
#include <optional>

#include "calibration/calibration_result.hpp"
#include "calibration/determined_fit.hpp"
#include "calibration/noise_stage.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

/// p-value below which a misfit is significant.
constexpr double kMisfitCertain = 1e-3;

/// Whether the noise is known before the fit: stated for all rows or for some.
bool noise_is_stated(const Measurements& measurements, const NoiseModel& stated);

/// [m] 1 sigma of a coordinate from the residuals of the fit without priors, drift and model misfit included. It scales
/// residuals to compare with priors if no noise is stated.
double sigma_of_residuals(const FitProblem& fit);

struct NoiseAssessment {
  NoiseReport report;
  Eigen::MatrixXd covariance;  ///< of the columns
};

/// Variance of unit weight: tr(R C R^T) / number of columns, with R the square-root information and C the covariance.
/// Predictions of folds scale their covariances by it. 1 if a column is not determined.
double variance_of_unit_weight(const Eigen::MatrixXd& sqrt_information, const Eigen::MatrixXd& covariance);

/// The linearised system at the end of a fit. Keeps references.
struct FittedSystem {
  const LeastSquaresProblem& problem;
  const Estimate& estimate;
  const Unknowns& free;
  const WhitenedSummary& system;
  const std::vector<double>& row_weights;
  int rank;  ///< number of columns that the system determines
};

/// Noise and covariance at the end of a fit with the estimate and unknowns of `fitted` and the weights of `fit`.
NoiseAssessment assess_noise(const FittedSystem& fitted, const FitProblem& fit, const NoiseModel& stated,
                             const RobustRows& robust, const EstimatedNoise& estimated);

/// Test of the residuals of an estimate against the scatter of the repeats; empty without repeats.
std::optional<LackOfFit> lack_of_fit(const ErrorModel& model, const Measurements& measurements,
                                     const Estimate& estimate, const Unknowns& free);

}  // namespace kdl_calibration
