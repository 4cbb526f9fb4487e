#pragma once

#include "programs/program.hpp"

namespace kdl_calibration {

/// Modules of ABB's controllers. ABB, Technical reference manual: RAPID instructions, functions and data types,
/// 3HAC16581-1 (confdata: quadrants of axes 1, 4 and 6, and cfx).
const ProgramLanguage& abb_rapid();

}  // namespace kdl_calibration
