#pragma once

// Controllers log measured joint values, which differ slightly whenever a pose is repeated. Poses count as the same if
// no joint value differs by more than 1e-4 rad or 0.1 mm, or a thousandth of the widest joint range if that is below
// 0.1 rad or m. At 3 m reach, 1e-4 rad moves a point by 0.3 mm.
//
//     const Measurements poses = with_poses_joined(measurements);

#include <Eigen/Core>
#include <vector>

#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// For each configuration (column of `joint_values` [rad] or [m]) the index of the first one at the same pose, possibly
/// its own.
std::vector<Eigen::Index> first_at_same_pose(const Eigen::MatrixXd& joint_values);

constexpr double kNeighbourDistance = 0.05;     ///< [rad] or [m] of a joint value
constexpr double kNeighbourPartOfRange = 0.05;  ///< of the range of the joint's values

/// The same for neighbours: each joint value is within kNeighbourDistance of the first one's, or within
/// kNeighbourPartOfRange if that is less. A neighbour is predicted better than a new pose, so folds keep neighbours
/// together.
std::vector<Eigen::Index> first_of_neighbours(const Eigen::MatrixXd& joint_values);

/// The measurements with configurations at the same pose merged under the first label, with mean joint values and their
/// rows as repeats. Train and test rows are not merged, nor are approaches from different sides. `remark` says what was
/// joined.
Measurements with_poses_joined(Measurements measurements);

}  // namespace kdl_calibration
