#pragma once

#include "kdl_calibration/robot.hpp"
#include "robot/dh_table.hpp"

namespace kdl_calibration {

/// A table of the chain. Neighbouring axes within 0.1 rad of parallel get d = 0 and, unless they are parallel to
/// rounding, a beta: so no number is much larger than the arm. Throws InputError for joints that mimic others, which no
/// table can state.
DhTable dh_table_of(const Robot& robot, DhConvention convention);

/// Of two robots with the same joints, by KDL at 1,000 random configurations in the limits of the first.
PoseDifference largest_difference(const Robot& a, const Robot& b);

}  // namespace kdl_calibration
