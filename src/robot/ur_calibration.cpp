#include "robot/ur_calibration.hpp"


#include <array>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

constexpr std::size_t kUrJoints = 6;
constexpr std::array<const char*, kUrJoints> kUrNames = {"shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint",
                                                         "wrist_1_joint",      "wrist_2_joint",       "wrist_3_joint"};
}  // namespace

void require_ur_joints(const Robot& robot) {
  bool known = robot.joints.size() == kUrJoints;
  std::string prefix;
  for (std::size_t i = 0; known && i < kUrJoints; ++i) {
    const std::string& name = robot.joints[i].name;
    const bool ends = name.ends_with(kUrNames[i]);
    prefix = i == 0 && ends ? name.substr(0, name.size() - std::string(kUrNames[0]).size()) : prefix;
    known = ends && name == prefix + kUrNames[i] && robot.joints[i].type != JointType::prismatic;
  }
  if (!known) {
    throw InputError(robot.source + ": is no Universal Robot: expected the joints " +
                     comma_separated({kUrNames.begin(), kUrNames.end()}));
  }
}

}  // namespace kdl_calibration
