#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/experiment.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/measuring_plan.hpp"
#include "kdl_calibration/monte_carlo.hpp"
#include "kdl_calibration/observability.hpp"
#include "kdl_calibration/pose_selection.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/saved_calibration.hpp"
#include "kdl_calibration/workspace.hpp"

namespace kdl_calibration {

/// What is to be planned.
struct PlanRequest {
  Robot robot;
  std::vector<TargetFrame> targets;  ///< to measure in each configuration
  Cell cell;                         ///< where the robot may go
  PointNoise noise;
  Priors priors;
  std::optional<Measurements> measured;  ///< what exists; the plan comes on top
  /// What an earlier calibration knows, with its covariance: the plan is made at its geometry and comes on top.
  std::optional<SavedCalibration> calibrated;
  /// Effects beyond geometry that the measurements are to tell: terms that the candidates tell apart, of the usual
  /// size, or with `calibrated` those that it has found, with what it knows of them.
  std::vector<EffectGroup> effects;
  int count = 30;                  ///< configurations to choose; with `accuracy` the most to try
  std::optional<double> accuracy;  ///< [m] promise for which the fewest configurations are looked for
  Figure accuracy_of = Figure::mean;
  Criterion criterion = Criterion::d_optimal;
  int starts = 8;
  int candidates = 5000;
  Eigen::MatrixXd tasks;  ///< joints x m: where predictions matter; empty: `workspace` configurations of the cell
  int workspace = 5000;
  Eigen::VectorXd home;  ///< where the way begins; empty: all joints at zero
  int monte_carlo = 0;   ///< runs that try the plan on virtual robots
  std::uint64_t seed = 1;
  int threads = 0;  ///< 0: one per core; the answer does not depend on it
  /// Called with the share of the choice and of the runs that is done, never from two threads at once.
  std::function<void(double)> choosing;
  std::function<void(double)> trying;
};

/// What a plan is and what it promises.
struct Plan {
  /// The irreducible model at the nominal geometry, or that of the calibration before, with the effects asked for.
  Experiment experiment;
  Candidates drawn;  ///< candidates, then the workspace
  Selection selection;
  MeasuringPlan sheet;  ///< the configurations in the order to drive them
  Prediction planned;   ///< over the tasks
  Prediction random;    ///< the same of 200 random designs, on average
  /// [m] of the worst configuration's RMS, see floor_of_worst_configuration; where nothing is given beforehand and the
  /// noise is independent.
  std::optional<double> floor;
  double worst_configuration = 0.0;  ///< [m] RMS of sigma over the targets, of tasks and chosen configurations
  ObservabilityIndices observability;
  double efficiency = 0.0;  ///< D-efficiency, a lower bound
  double seconds = 0.0;     ///< of travel
  std::optional<MonteCarloResult> monte_carlo;
};

/// Draws candidates within the cell, chooses among them, orders the choice and says what it will give.
/// Throws InputError as candidates(), nominal_experiment(), select_configurations() and select_for_accuracy() do, and
/// where effects are of measured torques or, without a calibration that has found it, ripple.
Plan make_plan(const PlanRequest& request);

/// What fewer configurations would give: those of the plan without the least useful ones, beside random choices of as
/// many.
struct CountedAccuracy {
  int count = 0;
  double plan = 0.0;    ///< [m] mean predicted 1 sigma over the tasks, at most 500; infinite where undetermined
  double random = 0.0;  ///< [m] the same of 20 random designs, on average
};
/// From as few configurations as could determine the model to all of the plan, in at most some 20 steps. The least
/// useful configuration is the one with the least tr(M^-1 A), M the information of all and A its own.
std::vector<CountedAccuracy> accuracy_by_count(const PlanRequest& request, const Plan& plan);

}  // namespace kdl_calibration
