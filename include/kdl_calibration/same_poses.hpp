#pragma once

// Controllers log the joint values that they read back: one pose comes with slightly different ones each time. Poses
// are the same where no joint value differs by more than 1e-4 rad or 0.1 mm, or by a thousandth of the widest range of
// a joint where that is less than 0.1. At a reach of 3 m a joint moves a point by at most 0.3 mm then.
//
//     const Measurements poses = with_poses_joined(measurements);

#include <Eigen/Core>
#include <vector>

#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// For each configuration (column of `joint_values` [rad] or [m]) the first one at the same pose, itself where it is
/// that.
std::vector<Eigen::Index> first_at_same_pose(const Eigen::MatrixXd& joint_values);

/// The same for neighbours: no joint value differs from the first one's by more than 0.05 rad or 50 mm, or by a
/// twentieth of the joint's range if that is less. A neighbour is predicted better than a new pose, so folds keep
/// neighbours together.
std::vector<Eigen::Index> first_of_neighbours(const Eigen::MatrixXd& joint_values);

/// The measurements with configurations at the same pose made one, under the label of the first: its joint values are
/// their mean, their rows are repeats of it. Train and test rows stay apart, and so do approaches from different sides.
/// `remark` says what was joined.
Measurements with_poses_joined(Measurements measurements);

}  // namespace kdl_calibration
