#pragma once

#include "programs/program.hpp"

namespace kdl_calibration {

/// FANUC teach pendant programs as text (LS files). Points are those with a taught group 1 that states the place of the
/// arm's own tool; increments (INC) stay as they are. Refused with line and position: a text that is cut short or goes
/// on after its end, a motion to a position that was not taught ("********"), a number or a group 1 twice.
const ProgramLanguage& fanuc_ls();

}  // namespace kdl_calibration
