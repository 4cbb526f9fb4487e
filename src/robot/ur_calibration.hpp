#pragma once


#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// Throws InputError unless the moving joints are the six of a Universal Robot, by their names in its URDF, with one
/// common prefix or none.
void require_ur_joints(const Robot& robot);

}  // namespace kdl_calibration
