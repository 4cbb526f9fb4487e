#pragma once

#include <vector>

#include "programs/program.hpp"
#include "programs/rapid_modules.hpp"
#include "programs/rapid_remarks.hpp"

namespace kdl_calibration::rapid {

/// Marks the data and frames of the modules that the program changes at run time: by an assignment, a search, or a
/// routine that takes them by reference. The result says it of each place. Adds remarks on tools, and on routines
/// elsewhere.
std::vector<bool> mark_assigned(const std::vector<ProgramText>& texts, Modules& modules, Remarks& remarks);

}  // namespace kdl_calibration::rapid
