#pragma once

#include <Eigen/Core>
#include <vector>

#include "base/random.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// The joints' limits; ±pi (±1 m for a prismatic joint) without limits.
JointRanges limits_of(const std::vector<MovingJoint>& joints);
/// ±90 degrees for the first four independent joints and ±180 degrees for the others; for six revolute joints.
JointRanges published_ranges(const std::vector<MovingJoint>& joints);

/// Configurations uniform in the ranges: joints x count.
Eigen::MatrixXd random_configurations(const JointRanges& ranges, int count, Random& random);
/// The same for a chain with mimic joints: the values of followers are computed from those of their leaders.
Eigen::MatrixXd random_configurations(const std::vector<MovingJoint>& joints, const JointRanges& ranges, int count,
                                      Random& random);

}  // namespace kdl_calibration
