#pragma once

#include <Eigen/Core>
#include <span>

#include "calibration/calibration_result.hpp"
#include "calibration/determined_fit.hpp"
#include "measurements/training_rows.hpp"
#include "validation/fold_prediction.hpp"

namespace kdl_calibration {

/// An estimate and its uncertainty. Keeps references.
struct UncertainEstimate {
  const ErrorModel& model;
  const DeterminedFit& fit;
  const Eigen::MatrixXd& covariance;  ///< of the free columns
  const Eigen::MatrixXd&
      candidate_sqrt_information;  ///< R of the whitened system, see WhitenedSummary::sqrt_information
  const NoiseReport& noise;
  const std::vector<HeldOutPoint>& held_out;
  double optimism = 1.0;           ///< of the selection, see TriedModels
  const Eigen::MatrixXd& assumed;  ///< see considered_steps()
  std::span<const PlausibleModel> plausible = {};
};

/// Predicted accuracy at the measured configurations, over the workspace, at the test rows and at the requested
/// configurations.
PredictedAccuracy predicted_accuracy(const UncertainEstimate& uncertain, const TrainingRows& rows,
                                     const Configurations& asked);

/// [m^2] Variance of predicted points at the measured configurations by what was fitted, without what the measurements
/// take as true.
double variance_of_fit(const PredictedAccuracy& predicted);

}  // namespace kdl_calibration
