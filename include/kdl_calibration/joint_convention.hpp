#pragma once

// How a controller counts its joints.
//
//     const JointConvention pendant = read_joint_convention("fanuc_r2000ic_165f_pendant.json");
//     const Measurements measurements = read_measurements(robot, "measurements.csv", &pendant);

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// Conversion of a controller's joint values to the URDF's: q_urdf = matrix * q_controller + offset [rad or m].
struct JointConvention {
  std::string name;                            ///< file name, for messages
  std::vector<std::string> controller_joints;  ///< m names
  std::vector<std::string> urdf_joints;        ///< m names
  Eigen::MatrixXd matrix;                      ///< m x m, invertible
  Eigen::VectorXd offset;                      ///< m
};

/// Reads a convention (JSON, see urdf/README.md). Throws InputError: unreadable file, malformed JSON, missing or
/// unknown key, wrong size, a name twice, a number that is not finite, a singular matrix.
JointConvention read_joint_convention(const std::filesystem::path& file);
JointConvention parse_joint_convention(std::string_view json, const std::string& source = "joint convention");

/// The convention with its rows ordered as `urdf_joints`. Throws InputError if the names do not match.
JointConvention matched_convention(const JointConvention& convention, const std::vector<std::string>& urdf_joints);

}  // namespace kdl_calibration
