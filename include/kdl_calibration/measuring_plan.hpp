#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// Travel time [s] of the slowest joint between two configurations at its maximum velocity (1 rad/s or 1 m/s if the
/// URDF states none). Acceleration is ignored.
double travel_time(const std::vector<MovingJoint>& joints, const Eigen::Ref<const Eigen::VectorXd>& from,
                   const Eigen::Ref<const Eigen::VectorXd>& to);

/// Travel time [s] from `home` through all columns of `joint_values` in order, without the way back.
double way_time(const std::vector<MovingJoint>& joints, const Eigen::VectorXd& home,
                const Eigen::MatrixXd& joint_values);

/// An order of the columns with a short travel time: nearest neighbours, then 2-opt (Croes 1958) until no reversal of a
/// section helps. Paths between configurations are not checked for collisions.
std::vector<Eigen::Index> short_way(const std::vector<MovingJoint>& joints, const Eigen::VectorXd& home,
                                    const Eigen::MatrixXd& joint_values);

/// Configurations to measure, in the order to drive them.
struct MeasuringPlan {
  std::vector<std::string> configurations;  ///< labels
  Eigen::MatrixXd joint_values;             ///< joints x N, in the URDF's convention [rad] or [m]
  std::vector<std::string> targets;         ///< to be measured in each configuration
  std::vector<std::string> notes;           ///< written to the file as comments
};

/// A measurements file (CSV) with empty coordinates to fill in: one row for each configuration and target. Joints are
/// in degrees or millimetres to 1e-9, named as in the URDF or the convention, without mimic joints. read_measurements
/// refuses it until no coordinate is empty. Throws InputError for a name that the format cannot represent and for a
/// convention that mixes angles and lengths.
std::string plan_csv(const MeasuringPlan& plan, const std::vector<MovingJoint>& joints,
                     const JointConvention* convention = nullptr);

}  // namespace kdl_calibration
