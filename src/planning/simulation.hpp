#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "estimation/identification.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/drive_signals.hpp"
#include "model/reduction.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration {

/// Largest number of rows of one simulated experiment.
constexpr int kMostSimulatedRows = 10'000'000;

/// Sizes of the true errors (1 sigma of normal distributions). The defaults are those of the published experiment.
struct ErrorSizes {
  double length = 0.0025;                               ///< [m] every geometric length error
  double angle = 3.0 * 3.14159265358979323846 / 180.0;  ///< [rad] every geometric angle error and joint offset
  double base_position = 0.002;                         ///< [m] each coordinate of the base
  double target_length = 0.0025;                        ///< [m] length of each tool
};

/// Indices of the parameters with true errors: those of the irreducible model and the gauge joint offsets. `complete`:
/// all but those of the base link, which are equivalent to a displaced base.
std::vector<std::size_t> with_true_errors(const ErrorModel& model, const Reduction& reduction, bool complete);

/// A simulated robot with its true geometry.
struct VirtualRobot {
  ErrorModel model;
  Estimate truth;
};

/// The published tools: (100, 0, 0), (0, 0, 100) and (70.7, 0, 70.7) mm in the flange frame; further ones are points
/// 100 mm from the flange in seeded directions.
std::vector<TargetFrame> published_targets(int count = 3);

/// Draws true errors for the parameters `with_errors` (indices), a base displaced from the measuring device's frame,
/// and errors of the tools' lengths.
VirtualRobot virtual_robot(const ErrorModel& model, const std::vector<std::size_t>& with_errors,
                           const std::vector<TargetFrame>& targets, const ErrorSizes& sizes, Random& random);
/// Three independent standard normal numbers.
Eigen::Vector3d normal_vector(Random& random);

/// The same robot with its displacement applied to X_WB.
VirtualRobot placed(VirtualRobot robot, const Eigen::Isometry3d& X_WB);

/// The same robot measured from several stations "S1", "S2" and so on: the first as before, the others anywhere
/// within a few metres. measure() divides the configurations among them, in their order.
VirtualRobot robot_at_stations(VirtualRobot robot, int stations, Random& random);

/// Gives the robot every term of these groups that the configurations can tell apart, with normally distributed
/// coefficients of 1 sigma `sigma` [rad or m].
void add_effects(VirtualRobot& robot, const std::vector<EffectGroup>& groups, const DrivenConfigurations& driven,
                 double sigma, Random& random);

/// Signals that a virtual robot's drives report.
struct SimulatedSignals {
  bool approach = false;
  /// The gravity torque of 10 kg at every later joint frame, plus a random part of a tenth of it (1 sigma), at least 1
  /// Nm or N.
  bool torques = false;
  /// An arm that warms up from 20 to 32 degC in the order of the stops, 0.3 apart (1 sigma), with 0, 5 or 10 kg.
  bool circumstances = false;
  std::uint64_t seed = 1;
};
/// Signals at `stops` (joints x N) of an arm that was at the stops `before` (joints x M, or empty).
DrivenConfigurations simulated_signals(const ErrorModel& model, const Eigen::MatrixXd& stops,
                                       const Eigen::MatrixXd& before, const SimulatedSignals& wanted);

struct MeasuringNoise {
  double sigma = 0.0;              ///< [m] of every coordinate, independent
  double orientation_sigma = 0.0;  ///< [rad] of every component of a measured orientation
  int repeats = 1;
  Eigen::Vector3d common = Eigen::Vector3d::Zero();    ///< [m] along the axes of W, shared by the points of one repeat
  std::optional<TrackerNoise> tracker = std::nullopt;  ///< of a tracker at the origin of W, instead of `sigma`
};

/// Simulated measurements of every target in every configuration.
Measurements measure(const VirtualRobot& robot, const Eigen::MatrixXd& joint_values, const MeasuringNoise& noise,
                     Random& random, Split split = Split::train);
/// The same with signals, which the measurements include. The order of measurement is not stated.
Measurements measure(const VirtualRobot& robot, const DrivenConfigurations& driven, const MeasuringNoise& noise,
                     Random& random, Split split = Split::train);

}  // namespace kdl_calibration
