#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "planning/simulation.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {

/// Monte Carlo simulation: every run draws a robot, measures it, calibrates it and compares predictions with the true
/// robot.
struct MonteCarlo {
  ErrorModel model;
  std::vector<std::size_t> with_errors;  ///< indices of parameters with true errors
  std::vector<TargetFrame> targets;
  ErrorSizes sizes;
  MeasuringNoise noise;
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();  ///< the base before its random displacement
  /// Configurations to measure and to predict (joints x N), drawn in each run or always the same.
  std::function<Eigen::MatrixXd(Random&)> train;
  std::function<Eigen::MatrixXd(Random&)> test;
  CalibrationSettings calibration;
  int runs = 100;
  int first = 0;           ///< number of the first run, so that several machines can share the work
  std::uint64_t seed = 1;  ///< run r draws from stream r
  int threads = 0;         ///< 0: one per core; the answer does not depend on it
  /// Called after each run with the completed share, never from two threads at once.
  std::function<void(double)> progress;
};

/// Held-out errors: 3D distances [m] between predicted and true positions of the targets in unmeasured configurations,
/// without noise. Runs whose calibration did not converge count as well.
struct MonteCarloResult {
  ErrorStatistics all;     ///< over runs, configurations and targets
  ErrorStatistics means;   ///< of each run's mean
  ErrorStatistics maxima;  ///< of each run's largest
  /// [m] RMS over the runs, test configurations x targets: the reference for a predicted sigma. Empty if runs differ in
  /// the number of test configurations.
  Eigen::MatrixXd rms;
  /// [m] The values behind `all`, `means` and `maxima`, ascending; above 1,000 values, 1,001 order statistics.
  std::vector<double> all_errors;
  std::vector<double> mean_errors;
  std::vector<double> largest_errors;
  std::vector<ErrorStatistics> each;  ///< of each run, in order
  std::vector<bool> trusted;
  int runs = 0;
  int not_trusted = 0;  ///< runs that did not converge or were rank deficient
};
MonteCarloResult run_monte_carlo(const MonteCarlo& experiment);

/// [m] First-order 3D 1 sigma of predicted held-out points due to noise alone, at the nominal geometry: the RMS over
/// the targets in test configurations of the first runs. Empty without noise, with tracker noise, and if the
/// measurements do not determine the model.
std::vector<double> predicted_errors(const MonteCarlo& experiment);

}  // namespace kdl_calibration
