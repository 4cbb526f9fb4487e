#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "measurements/measurement_columns.hpp"

namespace kdl_calibration {

/// The joint values that a file states: one per column of joint_columns(), for each of N configurations. Keeps
/// references.
struct StatedJoints {
  const Header& header;
  const ExpectedJoints& joints;
  const std::string& source;
  std::function<std::size_t(Eigen::Index)> line;  ///< of a configuration, for messages
};

/// The columns of the expected joints, then those of followers that the file has.
std::vector<Column> joint_columns(const Header& header);

/// Turns the controller's joint values (columns x N, [rad] or [m]) into the URDF's, in place; nothing without a joint
/// convention. Throws InputError for values beyond 1e12.
void apply_convention(const StatedJoints& stated, Eigen::Ref<Eigen::MatrixXd> values);

/// The values of all joints (joints x N) from those. Throws InputError for a follower that contradicts its leader.
Eigen::MatrixXd with_followers(const StatedJoints& stated, const Eigen::Ref<const Eigen::MatrixXd>& values);

/// The values of the columns (columns x N) that state these joint values (joints x N), with the convention undone.
Eigen::MatrixXd column_values(const StatedJoints& stated, const Eigen::MatrixXd& joint_values);

}  // namespace kdl_calibration
