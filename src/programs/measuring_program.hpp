#pragma once

#include <string>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measuring_plan.hpp"
#include "kdl_calibration/robot.hpp"
#include "programs/program.hpp"

namespace kdl_calibration {

/// The plan as a program: slow joint motions in the order to drive, a stop and a comment at each configuration.
/// `convention`: how the controller counts joints; none: as the URDF. Throws InputError for an arm without six joints,
/// and for a convention that names other joints than the language.
std::string measuring_program(const Robot& robot, const MeasuringPlan& plan, const JointConvention* convention,
                              const ProgramLanguage& language, const std::string& name);

}  // namespace kdl_calibration
