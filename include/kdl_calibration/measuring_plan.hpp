#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// Seconds that the slowest joint needs from one configuration to another at its greatest velocity; 1 rad/s or 1 m/s
/// where the URDF states none. Accelerations are left out.
double travel_time(const std::vector<MovingJoint>& joints, const Eigen::Ref<const Eigen::VectorXd>& from,
                   const Eigen::Ref<const Eigen::VectorXd>& to);

/// The same for all columns of `joint_values`, one after the other, from `home` and not back.
double way_time(const std::vector<MovingJoint>& joints, const Eigen::VectorXd& home,
                const Eigen::MatrixXd& joint_values);

/// An order of the columns that makes that time short: the nearest neighbour each, then 2-opt (Croes 1958) until no
/// reversal of a part of the way helps. The way between two configurations is not checked for collisions.
std::vector<Eigen::Index> short_way(const std::vector<MovingJoint>& joints, const Eigen::VectorXd& home,
                                    const Eigen::MatrixXd& joint_values);

/// Configurations to measure, in the order to drive them.
struct MeasuringPlan {
  std::vector<std::string> configurations;  ///< labels
  Eigen::MatrixXd joint_values;             ///< joints x N, in the URDF's convention [rad] or [m]
  std::vector<std::string> targets;         ///< to measure in each
  std::vector<std::string> notes;           ///< written as comments
};

/// A measurements file (CSV) whose coordinates are still to be filled in: one row for each configuration and target,
/// joints in degrees or millimetres under the URDF's names or, behind a convention, the controller's, to 1e-9 of the
/// unit, joints that mimic others left out. read_measurements refuses it until no coordinate is empty.
/// Throws InputError for a name that the format cannot hold and for a convention that mixes angles with lengths.
std::string plan_csv(const MeasuringPlan& plan, const std::vector<MovingJoint>& joints,
                     const JointConvention* convention = nullptr);

}  // namespace kdl_calibration
