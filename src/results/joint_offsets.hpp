#pragma once

// Zero offsets of the joints as a controller counts them, for mastering.

#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "kdl_calibration/joint_convention.hpp"

namespace kdl_calibration {

struct JointOffset {
  std::string joint;        ///< the controller's name
  bool slides = false;      ///< [m] rather than [rad]
  bool measurable = false;  ///< else base or targets take it up
  double add = 0.0;         ///< to the displayed value
  double add_alone = 0.0;   ///< the same if nothing else is corrected
  double std = 0.0;         ///< 1 sigma; infinite where not determined
  double degrees_of_freedom = 0.0;
};

/// In the order of the controller's joints. The convention matches the robot's independent joints.
std::vector<JointOffset> joint_offsets(const CalibrationResult& calibration, const JointConvention& convention);

}  // namespace kdl_calibration
