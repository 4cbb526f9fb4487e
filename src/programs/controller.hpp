#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/robot.hpp"
#include "programs/program.hpp"

namespace kdl_calibration {

/// The joint of the URDF that an external axis is.
struct ExternalAxis {
  std::string joint;  ///< none: the axis does not carry the arm
  bool is_reversed = false;
};
inline constexpr std::string_view kNotOfTheArm = "none";

/// How the controller of an arm counts joints, and where it has its frames.
struct Controller {
  std::optional<JointConvention> convention = {};          ///< none: the values of the URDF's joints, in its order
  Eigen::Isometry3d X_BW = Eigen::Isometry3d::Identity();  ///< its world frame in the base frame
  Eigen::Isometry3d X_FP = Eigen::Isometry3d::Identity();  ///< the faceplate in the flange frame
  ProgramFrames frames = {};                               ///< empty unless they are read as well
  std::map<int, ExternalAxis> external_axes = {};          ///< by number: 1 of E1
};

/// Reads such a description (JSON, see urdf/README.md) and the joint convention that it names. Throws InputError.
Controller read_controller(const std::filesystem::path& file);

/// The frames that REP 199 and ROS-Industrial give a URDF for this purpose: link `base` is the controller's world frame
/// and `tool0` the faceplate. Without them the robot's base and tip are.
Controller controller_of_links(const Robot& robot);

/// Joints of the robot by the number of an external axis, from pairs such as E1, rail and E2, -turntable. Throws
/// InputError; `where` names them in messages.
std::map<int, ExternalAxis> external_axes(const std::vector<std::pair<std::string, std::string>>& named,
                                          const Robot& robot, const std::string& where);
/// Joints that are external axes: a compensation holds them.
std::vector<std::string> carrying_joints(const Controller& controller);

/// User and tool frames of a file of the controller in this language, or of a file that ends in .json:
/// {"user_frames": {"1": {"position": [...], "quaternion_wxyz": [...]}}, "tool_frames": {...}}, metres. Throws
/// InputError.
ProgramFrames read_program_frames(const std::filesystem::path& file, const ProgramLanguage& language);

}  // namespace kdl_calibration
