#pragma once

#include <string>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/orientation_reading.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration::cli {

/// Points of one file, as a tracker's software writes them, and the joint values of their configurations from another.
struct JoinedFiles {
  std::string points;        ///< CSV as measurements, without joints
  std::string joint_values;  ///< CSV as a plan
  /// How the points' names are made, such as "C{configuration}_{target}". Empty: the points have a column
  /// `configuration`.
  std::string names;
  OrientationReading orientation = OrientationReading::usual;
};

/// Throws InputError as read_measurements does, for a pattern without both words, a name that does not match it, and a
/// configuration without joint values.
Measurements read_joined(const Robot& robot, const JoinedFiles& files, const JointConvention* convention);

}  // namespace kdl_calibration::cli
