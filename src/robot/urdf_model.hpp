#pragma once

#include <urdf_world/types.h>

#include <string>
#include <string_view>

namespace kdl_calibration {

/// The links and joints of a URDF as urdfdom reads them, without its console messages. Throws InputError for texts that
/// urdfdom refuses. Also refuses texts that it would read with other kinematics: loops, second parents, xacro macros,
/// rotations not in rpy.
urdf::ModelInterfaceSharedPtr parse_model(std::string_view text, const std::string& source);

}  // namespace kdl_calibration
