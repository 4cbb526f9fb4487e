#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "kdl_calibration/validation.hpp"

namespace kdl_calibration {

/// A target of a configuration that was left out, as the mean of its repeats, and its prediction by the others.
struct HeldOutPoint {
  std::int32_t configuration = 0;
  std::int32_t target = 0;
  double repeats = 1.0;                                  ///< that the mean is of
  Eigen::Vector3d measured = Eigen::Vector3d::Zero();    ///< [m] that mean, in W
  Eigen::Vector3d residual = Eigen::Vector3d::Zero();    ///< [m] that mean minus its prediction, along W
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< [m^2] of the prediction by the parameters alone, along W
};

struct FoldPrediction {
  std::vector<HeldOutPoint> points;
  int refits = 0;         ///< folds that were not as good as linear
  int not_converged = 0;  ///< of these
};

/// [m] of the points, in their order.
std::vector<double> distances_of(const FoldPrediction& prediction);

/// What folds are predicted by: a fit at its optimum. Keeps references.
struct FoldTask {
  const FitProblem& problem;  ///< whose start is the optimum
  /// R of the whitened Jacobian there, priors included, as WhitenedSummary::sqrt_information.
  const Eigen::MatrixXd& sqrt_information;
  double noise;  ///< [m] 1 sigma of a coordinate
};

/// Predicts each fold from the rest without a fit of its own: at the optimum the gradient without a fold is that of the
/// fold with the sign changed, and its information that of all less its own (Cook and Weisberg 1982, 2.2). Where that
/// linear prediction differs from the one at the estimate so moved by more than 0.1 of the noise, or where a fold takes
/// away what determines a column, the fold is fitted again. Folds hold indices of configurations.
FoldPrediction predict_folds(const FoldTask& task, const std::vector<std::vector<Eigen::Index>>& folds,
                             int threads = 0);

}  // namespace kdl_calibration
