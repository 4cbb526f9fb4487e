#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "estimation/least_squares.hpp"
#include "kdl_calibration/error_model.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {

/// A geometric parameter of an estimate and its true value; SI units, nominal values included.
struct ComparedParameter {
  std::size_t index = 0;  ///< into the model's parameters
  double estimated = 0.0;
  double truth = 0.0;           ///< as drawn
  double truth_in_gauge = 0.0;  ///< reference value in the estimate's gauge, see truth_in_gauge_of
  bool gauge = false;           ///< held fixed: not compared
};

/// Comparison of an estimate with a virtual robot's truth.
struct TruthComparison {
  Estimate truth_in_gauge;
  double gauge_misfit = 0.0;                    ///< [m] RMS distance of its predictions from those of the truth
  std::vector<ComparedParameter> parameters;    ///< estimated ones, the gauge, and those not nominal in either
  Vector6d base_difference = Vector6d::Zero();  ///< twist in the base frame from truth_in_gauge to the estimate
  double largest_length = 0.0;                  ///< [m] of a length, base and targets included, without gauge
  double largest_angle = 0.0;                   ///< [rad]
  ErrorStatistics points;                       ///< [m] distances of predicted from true target points, in W

  /// Whether the estimate's parameters can represent the truth, so that their differences are meaningful.
  bool comparable() const { return gauge_misfit < 1e-9; }
};

/// Estimate and truth in one model with the effects of both, zero where an arm lacks an effect. Throws InputError if
/// both have effects and their gravity directions differ.
struct ArmAndTruth {
  ErrorModel model;
  Estimate estimate;
  Estimate truth;
};
ArmAndTruth arm_and_truth(const ErrorModel& model, const Estimate& estimate, const VirtualRobot& truth);

/// As if there were one station, the truth's first. If the estimate has several, which may not determine all rotations,
/// its base is placed where its targets at `joint_values` (joints x N) are nearest to the true ones.
ArmAndTruth without_stations(ArmAndTruth arms, const Eigen::MatrixXd& joint_values);

/// Distances [m] between predicted and true target positions in W, target by target in each configuration.
std::vector<double> distances_from_truth(const ErrorModel& model, const Estimate& estimate, const Estimate& truth,
                                         const Eigen::MatrixXd& joint_values);

/// The truth in the gauge of the estimate. Base, targets and geometric errors of the irreducible model are fitted to
/// the truth's predictions at `joint_values` (joints x N). All other errors are held as in the estimate, effects as in
/// the truth. The irreducible model can represent any robot nearby, whatever its gauge.
Estimate truth_in_gauge_of(const ErrorModel& model, const Reduction& reduction, const Estimate& estimate,
                           const Estimate& truth, const Eigen::MatrixXd& joint_values);

/// Compares parameters up to the gauge, and predicted points at `joint_values`. Targets are matched by name. Throws
/// InputError if the truth lacks one.
TruthComparison compare_with_truth(const ErrorModel& model, const Estimate& estimate, const Estimate& truth,
                                   const Eigen::MatrixXd& joint_values);

}  // namespace kdl_calibration
