#pragma once

#include <urdf_world/types.h>

#include <string>
#include <string_view>

namespace kdl_calibration {

/// The links and joints of a URDF as urdfdom reads them, which prints nothing. Throws InputError for what urdfdom
/// refuses, and for what it accepts although the kinematics would be others: loops, second parents, macros of xacro,
/// rotations that are not in rpy.
urdf::ModelInterfaceSharedPtr parse_model(std::string_view text, const std::string& source);

}  // namespace kdl_calibration
