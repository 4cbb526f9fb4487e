#pragma once

#include <string>
#include <string_view>

#include "programs/program.hpp"

namespace kdl_calibration {

/// Reads the frames of motion group 1 from SYSFRAME.VA of a FANUC controller's backup. Frames that are not set are left
/// out. Throws InputError.
ProgramFrames parse_system_frames(std::string_view text, const std::string& source);

}  // namespace kdl_calibration
