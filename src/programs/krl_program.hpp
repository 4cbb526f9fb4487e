#pragma once

#include "programs/program.hpp"

namespace kdl_calibration {

/// Programs in the KUKA Robot Language: .src with the points of the .dat that has the same stem, or one of both.
///
/// Keys of frames are the numbers of TOOL_DATA and BASE_DATA, with 0 for the identity; a frame that the program states
/// without a number has its values as key.
const ProgramLanguage& kuka_krl();

}  // namespace kdl_calibration
