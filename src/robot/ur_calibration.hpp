#pragma once

#include <array>
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

/// The keys of a yaml file, from shoulder to wrist_3, and those of each of its frames.
inline constexpr std::array kUrLinks = {"shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"};
inline constexpr std::array kUrNumbers = {"x", "y", "z", "roll", "pitch", "yaw"};

/// Throws InputError unless the robot is the description for ROS whose joint origins a yaml file sets: the joints of
/// require_ur_joints, each of which turns about z.
void require_ur_description(const Robot& robot);

/// Whether the text is the yaml that ur_calibration of the ROS driver writes, with the key `kinematics`.
bool is_ur_yaml(std::string_view text);

/// The joint origins that it states. Throws InputError: another robot or description, a missing or repeated number,
/// another key, an origin more than 0.1 m or 0.1 rad from that of the robot.
std::vector<NewOrigin> ur_origins(const Robot& robot, std::string_view yaml, const std::string& source);

}  // namespace kdl_calibration
