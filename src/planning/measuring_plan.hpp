#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "kdl_calibration/measuring_plan.hpp"
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

/// The file of plan_csv with decimal commas in the columns that have a unit, and semicolons between them.
std::string with_decimal_commas(const std::string& csv);

}  // namespace kdl_calibration
