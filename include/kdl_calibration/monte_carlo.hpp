#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/simulation.hpp"
#include "kdl_calibration/validation.hpp"

namespace kdl_calibration {

/// The whole experiment, many times: every run draws a robot, measures it, calibrates it and looks at how far the
/// calibrated robot's predictions are from the true robot.
struct MonteCarlo {
  ErrorModel model;
  std::vector<std::size_t> with_errors;  ///< parameters of the model that get true errors
  std::vector<TargetFrame> targets;
  ErrorSizes sizes;
  MeasuringNoise noise;
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();  ///< the base as it stands before it is displaced
  /// Configurations to measure and to predict (joints x N), drawn anew in each run or the same ones.
  std::function<Eigen::MatrixXd(Random&)> train;
  std::function<Eigen::MatrixXd(Random&)> test;
  CalibrationOptions calibration;
  int runs = 100;
  std::uint64_t seed = 1;  ///< run r draws from stream r
  int threads = 0;         ///< 0: one per core; the answer does not depend on it
  /// Called after each run with the share of the work that is done, never from two threads at once.
  std::function<void(double)> progress;
};

/// Held-out errors: 3D distances [m] between the calibrated robot's prediction of a target in a configuration that was
/// not measured and where the true robot puts it, without noise. Runs whose calibration did not converge count as well.
struct MonteCarloResult {
  ErrorStatistics all;     ///< over runs, configurations and targets
  ErrorStatistics means;   ///< of each run's mean
  ErrorStatistics maxima;  ///< of each run's largest
  /// [m] RMS over the runs, test configurations x targets: what a predicted sigma should equal. Empty where the number
  /// of test configurations differs between runs.
  Eigen::MatrixXd rms;
  /// [m] What `all`, `means` and `maxima` are statistics of, ascending; of more than 1,000 values 1,001 order
  /// statistics.
  std::vector<double> all_errors;
  std::vector<double> mean_errors;
  std::vector<double> largest_errors;
  int runs = 0;
  int not_trusted = 0;  ///< runs whose calibration did not converge or was not determined
};
MonteCarloResult run_monte_carlo(const MonteCarlo& experiment);

/// [m] 3D 1 sigma that the noise alone gives the predictions of held-out points to first order, at the nominal
/// geometry: the RMS over the targets in test configurations of the first runs. Empty without noise, for a tracker's
/// own noise, and where the measurements do not determine the model.
std::vector<double> predicted_errors(const MonteCarlo& experiment);

}  // namespace kdl_calibration
