#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "estimation/identification.hpp"
#include "planning/simulation.hpp"
#include "planning/truth_comparison.hpp"
#include "two_step/two_step.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {

/// The published experiment: the two-step procedure against a virtual robot.
struct TwoStepTrial {
  VirtualRobot robot;
  std::function<Eigen::MatrixXd(Random&)> configurations;  ///< draws the configurations of one round, joints x N
  MeasuringNoise noise;
  int rounds = 10;
  bool recorded = false;                      ///< reuse the first round's measurements instead of fresh ones
  Eigen::MatrixXd held_out;                   ///< joints x N, for the comparison with the truth
  std::function<void(double)> progress = {};  ///< called with the completed share
};

struct TwoStepTrialRound {
  TwoStepRound round;
  ErrorStatistics held_out;  ///< [m] distances between estimated and true points
};

struct TwoStepTrialResult {
  Identification identification;
  std::vector<TwoStepTrialRound> rounds;
  /// Converged or, with noise and fresh configurations, a last change of at most twice `floor`.
  bool settled = false;
  double floor = 0.0;   ///< [m] change due to noise: sigma · sqrt(geometric errors / points)
  double factor = 0.0;  ///< of linear convergence, while well above the floor; 0: none seen
  TruthComparison truth;
};

/// Starts from the nominal geometry with base and targets registered to the first round's measurements, and estimates
/// the geometric errors of the irreducible model. The truth is used for simulation and comparison only. Throws
/// InputError if a round has fewer coordinates than a step has unknowns.
TwoStepTrialResult run_two_step_trial(const TwoStepTrial& trial, Random& random);

}  // namespace kdl_calibration
