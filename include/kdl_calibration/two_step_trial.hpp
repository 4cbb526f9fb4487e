#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/simulation.hpp"
#include "kdl_calibration/truth_comparison.hpp"
#include "kdl_calibration/two_step.hpp"
#include "kdl_calibration/validation.hpp"

namespace kdl_calibration {

/// The published experiment: the two-step procedure against a virtual robot.
struct TwoStepTrial {
  VirtualRobot robot;
  std::function<Eigen::MatrixXd(Random&)> configurations;  ///< draws those of one round, joints x N
  MeasuringNoise noise;
  int rounds = 10;
  bool recorded = false;                      ///< the first round's measurements in every round, instead of fresh ones
  Eigen::MatrixXd held_out;                   ///< joints x N, where the estimate is compared with the truth
  std::function<void(double)> progress = {};  ///< called with the share of the rounds done
};

struct TwoStepTrialRound {
  TwoStepRound round;
  ErrorStatistics held_out;  ///< [m] distance of the estimated from the true model
};

struct TwoStepTrialResult {
  Identification identification;
  std::vector<TwoStepTrialRound> rounds;
  /// Converged; or, with noise and fresh configurations, a last change no larger than twice what noise alone causes.
  bool settled = false;
  double floor = 0.0;   ///< [m] that change: sigma · sqrt(geometric errors / points)
  double factor = 0.0;  ///< of linear convergence, while the change is well above the floor; 0 where none was seen
  TruthComparison truth;
};

/// Starts from the nominal geometry with base and targets registered to the first round's measurements, and estimates
/// the geometric errors of the irreducible model. The truth serves to measure and to judge, never to estimate.
/// Throws InputError where a round measures fewer coordinates than one of its two steps has unknowns.
TwoStepTrialResult run_two_step_trial(const TwoStepTrial& trial, Random& random);

}  // namespace kdl_calibration
