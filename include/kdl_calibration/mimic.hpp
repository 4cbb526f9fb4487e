#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

// People and files give the values of the independent joints. Where these enter, the followers' values (see Mimic) are
// filled in, and everything inside sees the values of all joints, of which KDL's chain has as many.

/// Indices of the joints that follow none, base to tip.
std::vector<std::size_t> independent_joints(const std::vector<MovingJoint>& joints);
/// Their names.
std::vector<std::string> independent_joint_names(const std::vector<MovingJoint>& joints);

/// Sets the rows of the followers from those of their leaders; `q` is joints x N, [rad] or [m].
void follow(const std::vector<MovingJoint>& joints, Eigen::Ref<Eigen::MatrixXd> q);

/// Values of all joints (joints x N) from those of the independent ones (independent joints x N), and back.
Eigen::MatrixXd all_joint_values(const std::vector<MovingJoint>& joints,
                                 const Eigen::Ref<const Eigen::MatrixXd>& independent);
Eigen::MatrixXd independent_joint_values(const std::vector<MovingJoint>& joints,
                                         const Eigen::Ref<const Eigen::MatrixXd>& all);

}  // namespace kdl_calibration
