#pragma once

// Not installed.

#include <Eigen/Core>
#include <vector>

namespace kdl_calibration {

/// For each configuration (column of `joint_values`) the first one at the same joint values, itself where it is that.
std::vector<Eigen::Index> first_at_same_values(const Eigen::MatrixXd& joint_values);

}  // namespace kdl_calibration
