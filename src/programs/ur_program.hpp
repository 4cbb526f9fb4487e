#pragma once

#include "programs/program.hpp"

namespace kdl_calibration {

/// Programs of Universal Robots as text (URScript): poses p[x, y, z, rx, ry, rz] of the tool (set_tcp) in the robot's
/// base, and lists of six joint values, as arguments of motions or in variables that motions use. A pose has no branch:
/// the controller takes the joint values next to those before, or next to qnear of get_inverse_kin. Expressions other
/// than literals are known at run time only.
const ProgramLanguage& ur_script();

}  // namespace kdl_calibration
