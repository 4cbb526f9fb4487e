#pragma once

#include <functional>
#include <kdl/frames.hpp>
#include <kdl/jntarray.hpp>

#include "kdl_calibration/robot.hpp"
#include "robot/dh_table.hpp"

namespace kdl_calibration {

/// A table of the chain. Neighbouring axes within 0.1 rad of parallel get d = 0 and, unless they are parallel to
/// rounding, a beta: so no number is much larger than the arm. Throws InputError for joints that mimic others, which no
/// table can state.
DhTable dh_table_of(const Robot& robot, DhConvention convention);

/// Of two robots with the same joints, by KDL at 1,000 random configurations in the limits of the first.
PoseDifference largest_difference(const Robot& a, const Robot& b);
/// The same of a robot and of another function for the tip in the base.
PoseDifference largest_difference(const Robot& robot, const std::function<KDL::Frame(const KDL::JntArray&)>& other);

}  // namespace kdl_calibration
