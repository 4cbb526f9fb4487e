#pragma once

// What three numbers of a measured orientation mean, where a file leaves it open.
//
//     const Measurements poses = read_measurements(robot, "poses.csv", nullptr, OrientationReading::fixed_xyz);

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// Columns rx, ry, rz (roll, pitch, yaw; W, P, R) are angles about x, y and z in every reading but the first. A, B, C
/// are about z, y and x if moving_zyx is read, and about x, y and z otherwise.
enum class OrientationReading {
  usual,            ///< rx, ry, rz: a rotation vector; A, B, C: moving_zyx; all others: fixed_xyz
  rotation_vector,  ///< the axis times the angle (Universal Robots)
  fixed_xyz,        ///< Rz Ry Rx: about the axes of the reference (Yaskawa, Kinova, FANUC)
  moving_xyz,       ///< Rx Ry Rz: about the axes of the turned frame (Staubli)
  moving_zyx,       ///< Rz Ry Rx: about the axes of the turned frame (KUKA)
};

/// "rotation-vector", "fixed-xyz", "moving-xyz", "moving-zyx"; empty for usual.
std::string to_string(OrientationReading reading);
/// The words of all readings but the usual one.
std::vector<std::string> orientation_words();
/// Throws InputError for another text than one of those words or nothing.
OrientationReading orientation_reading(std::string_view word);

/// See read_measurements of measurements.hpp. Also throws InputError if a reading is stated, and the file has no
/// orientations or quaternions.
Measurements read_measurements(const Robot& robot, const std::filesystem::path& file, const JointConvention* convention,
                               OrientationReading reading);
Measurements parse_measurements(const Robot& robot, std::string_view csv, const JointConvention* convention,
                                const std::string& source, OrientationReading reading);

}  // namespace kdl_calibration
