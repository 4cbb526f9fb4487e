#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

// People and files give the values of the independent joints, and of a drive outside the chain instead of the joint
// that it moves (see Drive). Where these enter, the values of all joints of the chain are computed from them (see
// Mimic). Everything inside sees those.

/// Indices of the joints that follow none, base to tip.
std::vector<std::size_t> independent_joints(const std::vector<MovingJoint>& joints);
/// The joint's drive; itself, times 1 plus 0, if it has none.
Drive drive_of(const MovingJoint& joint);
/// Names of the drives of the independent joints.
std::vector<std::string> independent_joint_names(const std::vector<MovingJoint>& joints);

/// Sets the rows of the followers from those of their leaders; `q` is joints x N, [rad] or [m].
void follow(const std::vector<MovingJoint>& joints, Eigen::Ref<Eigen::MatrixXd> q);

/// Values of all joints (joints x N) from those of the independent ones (independent joints x N), and back.
Eigen::MatrixXd all_joint_values(const std::vector<MovingJoint>& joints,
                                 const Eigen::Ref<const Eigen::MatrixXd>& independent);
Eigen::MatrixXd independent_joint_values(const std::vector<MovingJoint>& joints,
                                         const Eigen::Ref<const Eigen::MatrixXd>& all);

}  // namespace kdl_calibration
