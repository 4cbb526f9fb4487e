#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/robot.hpp"
#include "robot/urdf_correction.hpp"

namespace kdl_calibration {

/// Throws InputError unless the moving joints are the six of a Universal Robot, by their names in its URDF, with one
/// common prefix or none.
void require_ur_joints(const Robot& robot);

/// Corrections that give the nominal URDF of a Universal Robot the kinematics of its calibration.conf, which the
/// controller keeps. Its lists delta_theta, delta_a, delta_d, delta_alpha are added to the nominal table (standard DH),
/// whose lengths are read from the URDF. The chain is exactly that of the sums. The file places joints 2 and 3 up to
/// hundreds of metres along their nearly parallel axes; the corrected joint origins stay where they are seen.
/// Throws InputError: another robot, a URDF that is not nominal, a missing list or one without six numbers, a
/// calibration that the file calls unfinished.
std::vector<OriginCorrection> ur_corrections(const Robot& robot, std::string_view calibration,
                                             const std::string& source);

}  // namespace kdl_calibration
