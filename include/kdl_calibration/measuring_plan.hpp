#pragma once

// Which configurations to measure.
//
//     const MeasuringPlan plan = plan_measurements(robot, {.count = 30, .least_height = 0.2});
//     std::ofstream("plan.csv") << plan_csv(plan, robot.joints);
//     // After a repair: eight configurations that tell what has changed, for a calibration with priors.earlier.
//     const MeasuringPlan few = plan_measurements(robot, {.after = &found, .suspect = {"joint_5"}});

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

class Calibration;

/// Largest number of configurations of a plan.
constexpr int kMostPlanned = 2000;

struct PlanOptions {
  std::optional<int> count = std::nullopt;  ///< configurations, up to kMostPlanned; 30, with `after` 8
  /// On the flange; empty: those of `after`, else the three published ones.
  std::vector<TargetFrame> targets = {};
  JointRanges ranges = {};                            ///< where the joints may go; empty: their limits
  double noise = 3e-5;                                ///< [m] 1 sigma of every measured coordinate
  std::optional<double> least_height = std::nullopt;  ///< [m] of every target above the base's x-y plane
  std::optional<double> least_radius = std::nullopt;  ///< [m] of every target from the first joint's axis
  std::uint64_t seed = 1;
  /// The calibration of a robot that may have changed since: the plan tells what has, with base and targets anew.
  const Calibration* after = nullptr;
  std::vector<std::string> suspect = {};            ///< joints that may have changed since `after`; empty: all
  std::function<void(double share)> progress = {};  ///< called with the completed share, from any thread, one at a time
};

/// Configurations to measure, in the order to drive them.
struct MeasuringPlan {
  std::vector<std::string> configurations;  ///< labels
  Eigen::MatrixXd joint_values;             ///< joints x N, in the URDF's convention [rad] or [m]
  std::vector<std::string> targets;         ///< to be measured in each configuration
  std::vector<std::string> notes;           ///< written to the file as comments
  std::vector<std::string> warnings;        ///< what measurements of it cannot tell
  std::vector<std::string> stations;        ///< of each configuration; empty: one that needs no name
  Eigen::Matrix3Xd points;                  ///< [m] 3 x N: the sockets to touch, known in W; empty: to be measured
  bool distances = false;                   ///< from the anchor, the station, are to be measured instead of x, y and z
  double predicted_mean = 0.0;              ///< [m] 3D 1 sigma of a predicted target, mean over the workspace
  double predicted_max = 0.0;               ///< [m] the same, the largest
};

/// The D-optimal choice among random configurations within the ranges. Paths are not checked for collisions. Throws
/// InputError: too few configurations to determine the parameters, ranges of other joints, hardly any configuration
/// that keeps the limits, `after` of another robot or with several stations, unknown suspects.
MeasuringPlan plan_measurements(const Robot& robot, const PlanOptions& options = {});

/// A measurements file (CSV) with empty coordinates to fill in, or with those of the sockets: one row for each
/// configuration and target. Joints are in degrees or millimetres to 1e-9, named as in the URDF or the convention,
/// without mimic joints. read_measurements refuses it while a row has nothing filled in. Throws InputError for a name
/// that the format cannot represent and for a convention that mixes angles and lengths.
std::string plan_csv(const MeasuringPlan& plan, const std::vector<MovingJoint>& joints,
                     const JointConvention* convention = nullptr);

}  // namespace kdl_calibration
