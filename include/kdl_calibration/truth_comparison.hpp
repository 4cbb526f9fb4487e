#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/simulation.hpp"
#include "kdl_calibration/validation.hpp"

namespace kdl_calibration {

/// A geometric parameter of an estimate beside the truth; SI units, nominal values included.
struct ComparedParameter {
  std::size_t index = 0;  ///< into the model's parameters
  double estimated = 0.0;
  double truth = 0.0;           ///< as it was drawn
  double truth_in_gauge = 0.0;  ///< what the estimate should have been, see truth_in_gauge_of
  bool gauge = false;           ///< held by choice: there is nothing to compare
};

/// An estimate beside the truth of a virtual robot.
struct TruthComparison {
  Estimate truth_in_gauge;
  double gauge_misfit = 0.0;                    ///< [m] RMS distance of what that predicts from the truth's predictions
  std::vector<ComparedParameter> parameters;    ///< estimated ones, the gauge, and what differs from nominal in either
  Vector6d base_difference = Vector6d::Zero();  ///< twist in the base frame from the truth in gauge to the estimate
  double largest_length = 0.0;  ///< [m] difference of a length, base and targets included and the gauge left out
  double largest_angle = 0.0;   ///< [rad]
  ErrorStatistics points;       ///< [m] distances of predicted from true target points, in W

  /// Whether the estimate's parameters can say what the truth is, so that their differences mean something.
  bool comparable() const { return gauge_misfit < 1e-9; }
};

/// Two arms as one model: with the effects of both, each estimate having zeros for the other's. Throws InputError where
/// both have effects and gravity pulls in another direction.
struct ArmAndTruth {
  ErrorModel model;
  Estimate estimate;
  Estimate truth;
};
ArmAndTruth as_one_model(const ErrorModel& model, const Estimate& estimate, const VirtualRobot& truth);

/// Distances [m] of the targets' predicted from their true positions in W, target by target in each configuration.
std::vector<double> distances_from_truth(const ErrorModel& model, const Estimate& estimate, const Estimate& truth,
                                         const Eigen::MatrixXd& joint_values);

/// What the estimate should have been: the irreducible model's base, targets and geometric errors, fitted to the
/// truth's predictions at `joint_values` (joints x N), with all other errors (the gauge among them) held as in the
/// estimate, and the effects as in the truth. As many parameters as the predictions depend on describe every robot near
/// by, whatever its own gauge.
Estimate truth_in_gauge_of(const ErrorModel& model, const Reduction& reduction, const Estimate& estimate,
                           const Estimate& truth, const Eigen::MatrixXd& joint_values);

/// Compares parameters up to the gauge, and predicted points at `joint_values`. The targets of the estimate are matched
/// to those of the truth by name. Throws InputError where the truth lacks one of them.
TruthComparison compare_with_truth(const ErrorModel& model, const Estimate& estimate, const Estimate& truth,
                                   const Eigen::MatrixXd& joint_values);

}  // namespace kdl_calibration
