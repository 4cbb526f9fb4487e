#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "planning/experiment.hpp"
#include "planning/measuring_plan.hpp"
#include "planning/monte_carlo.hpp"
#include "planning/pose_selection.hpp"
#include "planning/workspace.hpp"
#include "results/saved_calibration.hpp"
#include "uncertainty/observability.hpp"

namespace kdl_calibration {

/// [m] or [rad] 1 sigma of what a collision or a repair does to a geometric error.
inline constexpr double kOrdinaryChange = 1e-3;

/// Configurations of a plan unless their number is stated; after a calibration few tell what has changed.
inline constexpr int kConfigurationsToPlan = 30;
inline constexpr int kConfigurationsAfter = 8;

/// The planning problem.
struct PlanRequest {
  Robot robot;
  std::vector<TargetFrame> targets;  ///< measured in each configuration
  Cell cell;                         ///< limits of the robot's motion
  PointNoise noise;
  Priors priors;
  std::optional<Measurements> measured;  ///< existing measurements, which the plan extends
  /// An earlier calibration and its covariance: the plan uses its geometry and adds to its information.
  std::optional<CalibrationParts> calibrated;
  /// Joints whose geometric errors may have changed since `calibrated`, each by about kOrdinaryChange; base and targets
  /// are then new. Empty: every joint. None: all is as it was.
  std::optional<std::vector<std::string>> suspects;
  /// Effects to be identified: the terms found by `calibrated` with their covariance, else the terms that the
  /// candidates can tell apart, with a prior of usual size.
  std::vector<EffectGroup> effects;
  int count = kConfigurationsToPlan;  ///< configurations to choose; with `accuracy` their maximum
  std::optional<double> accuracy;     ///< [m] required predicted accuracy; the fewest configurations are chosen
  Figure accuracy_of = Figure::mean;
  Criterion criterion = Criterion::d_optimal;
  int starts = 8;
  int candidates = 5000;
  Eigen::MatrixXd tasks;  ///< joints x m: where to predict; empty: `workspace` configurations of the cell
  int workspace = 5000;
  Eigen::VectorXd home;  ///< start of the path; empty: all joints at zero
  int monte_carlo = 0;   ///< runs that test the plan on virtual robots
  std::uint64_t seed = 1;
  int threads = 0;  ///< 0: one per core; the answer does not depend on it
  /// Called with the completed share of the selection and of the runs, never from two threads at once.
  std::function<void(double)> choosing;
  std::function<void(double)> trying;
};

/// A plan and its predicted accuracy.
struct Plan {
  /// The irreducible model at the nominal or the earlier calibration's geometry, with the requested effects.
  Experiment experiment;
  Candidates drawn;                     ///< candidates, then the workspace
  std::vector<NarrowedRange> narrowed;  ///< joints that the cell's constraints keep from most of their range
  Selection selection;
  MeasuringPlan sheet;  ///< the configurations in the order to drive them
  Prediction planned;   ///< over the tasks
  Prediction random;    ///< mean of 200 random designs
  /// [m] lower bound of the worst configuration's RMS, see floor_of_worst_configuration. Only without prior information
  /// and for independent noise.
  std::optional<double> floor;
  double worst_configuration = 0.0;  ///< [m] largest RMS of sigma over the targets, at tasks and chosen configurations
  ObservabilityIndices observability;
  double efficiency = 0.0;  ///< D-efficiency, a lower bound
  double seconds = 0.0;     ///< travel time [s]
  std::optional<MonteCarloResult> monte_carlo;
};

/// Draws candidates within the cell, selects and orders configurations, and predicts their accuracy. Throws InputError
/// as candidates(), nominal_experiment(), select_configurations() and select_for_accuracy() do, for torque effects, for
/// ripple unless an earlier calibration has found it, and for suspects that are no joints of the robot.
Plan make_plan(const PlanRequest& request);

/// Predicted accuracy with fewer configurations: the plan without its least useful ones, and random designs of equal
/// size.
struct CountedAccuracy {
  int count = 0;
  double plan = 0.0;    ///< [m] mean predicted 1 sigma over up to 500 tasks; infinite if undetermined
  double random = 0.0;  ///< [m] mean of 20 random designs
};
/// For counts from the fewest that could determine the model up to the whole plan, in about 20 steps. The least useful
/// configuration has the least tr(M^-1 A), M the total information and A its own.
std::vector<CountedAccuracy> accuracy_by_count(const PlanRequest& request, const Plan& plan);

}  // namespace kdl_calibration
