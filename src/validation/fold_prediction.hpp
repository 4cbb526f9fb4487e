#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "validation/validation.hpp"

namespace kdl_calibration {

/// A target of a left-out configuration (mean of its repeats) and its prediction from the other configurations.
struct HeldOutPoint {
  std::int32_t configuration = 0;
  std::int32_t target = 0;
  double repeats = 1.0;                                  ///< number of repeats
  NoiseFactors noise = {};                               ///< of its rows
  Eigen::Vector3d measured = Eigen::Vector3d::Zero();    ///< [m] mean of the repeats, in W
  Eigen::Vector3d residual = Eigen::Vector3d::Zero();    ///< [m] mean minus prediction, along W
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< [m^2] of the prediction by the parameters alone, along W
};

struct FoldPrediction {
  std::vector<HeldOutPoint> points;
  int refits = 0;         ///< folds fitted again because not nearly linear
  int not_converged = 0;  ///< of these
};

/// [m] norms of the residuals, in the order of the points.
std::vector<double> distances_of(const FoldPrediction& prediction);

/// A fit at its optimum, from which folds are predicted. Keeps references.
struct FoldTask {
  const FitProblem& problem;  ///< its start is the optimum
  /// R of the whitened Jacobian there, priors included, as WhitenedSummary::sqrt_information.
  const Eigen::MatrixXd& sqrt_information;
  double noise;  ///< [m] 1 sigma of a coordinate
};

/// Predicts each fold from the rest by one linear step (Cook and Weisberg 1982, 2.2). At the optimum, leaving a fold
/// out gives minus its gradient, and its information is subtracted. A fold is fitted again if the linear prediction is
/// off by more than 0.1 of the noise, or if the rest does not determine a column. Folds hold indices of configurations.
FoldPrediction predict_folds(const FoldTask& task, const std::vector<std::vector<Eigen::Index>>& folds,
                             int threads = 0);

/// The distances of the same, with the whitened Jacobian computed at the optimum, where the problem starts.
std::vector<double> fold_distances(const FitProblem& problem, const std::vector<std::vector<Eigen::Index>>& folds,
                                   double noise, int threads = 0);

}  // namespace kdl_calibration
