#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

// Users and files state the values of independent joints, or of a drive outside the chain instead of its joint (see
// Drive). On input the values of all joints of the chain are computed (see Mimic); the rest of the library uses those.

/// Indices of the joints that mimic no other, base to tip.
std::vector<std::size_t> independent_joints(const std::vector<MovingJoint>& joints);
/// The joint's drive; without one the joint itself (multiplier 1, offset 0).
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

/// Tolerance of a follower's value [rad or m], for values rounded to 0.001 degrees or 0.01 mm.
double follower_tolerance(double multiplier);

/// The first follower whose value is not that of its leader; none if all follow.
std::optional<std::size_t> follower_astray(const std::vector<MovingJoint>& joints,
                                           const Eigen::Ref<const Eigen::VectorXd>& q);

}  // namespace kdl_calibration
