#pragma once

// Not installed.

#include <Eigen/Core>
#include <filesystem>
#include <string>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// The text of a file of configurations, read as `asked`, with other joint values (joints x configurations, as in
/// `asked`) at full precision. Columns, units, separator, decimal mark and all other cells stay; comments do not.
std::string with_joint_values(const Robot& robot, const std::filesystem::path& file, const JointConvention* convention,
                              const Measurements& asked, const Eigen::MatrixXd& joint_values);

}  // namespace kdl_calibration
