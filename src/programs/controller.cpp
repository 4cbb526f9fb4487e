#include "programs/controller.hpp"

#include <algorithm>
#include <utility>

#include "base/json_tree.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/fixed_frame.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Isometry3d;

Isometry3d frame_in(const tree::Node& node) {
  Isometry3d frame = Isometry3d::Identity();
  frame.translation() = tree::numbers<3>(tree::member(node, "position"));
  frame.linear() = tree::quaternion(tree::member(node, "quaternion_wxyz")).toRotationMatrix();
  return frame;
}

tree::Json parsed_file(const std::filesystem::path& file) { return tree::parsed(read_text_file(file), file.string()); }

ProgramFrames frames_of_json(const std::filesystem::path& file) {
  const tree::Json json = parsed_file(file);
  const tree::Node top{json, file.string()};
  ProgramFrames frames;
  for (const auto& [key, kind] : {std::pair{"user_frames", &frames.user}, std::pair{"tool_frames", &frames.tool}}) {
    if (tree::has(top, key)) {
      const tree::Node node = tree::member(top, key);
      for (const auto& [name, value] : node.json.items()) {
        (*kind)[name] = frame_in({value, node.where + "." + name});
      }
    }
  }
  if (frames.user.empty() && frames.tool.empty()) {
    tree::fail(top, "frames in user_frames or tool_frames");
  }
  return frames;
}

}  // namespace

Controller read_controller(const std::filesystem::path& file) {
  const tree::Json json = parsed_file(file);
  const tree::Node top{json, file.string()};
  const std::filesystem::path convention = tree::name(tree::member(top, "joint_convention"));
  return {.convention = read_joint_convention(file.parent_path() / convention),
          .X_BW = frame_in(tree::member(top, "world_in_base")),
          .X_FP = frame_in(tree::member(top, "faceplate_in_flange"))};
}

Controller controller_of_links(const Robot& robot) {
  const KDL::Frame same;
  return {.X_BW = to_eigen(fixed_frame(robot, robot.base, "base").value_or(same)),
          .X_FP = to_eigen(fixed_frame(robot, robot.tip, "tool0").value_or(same))};
}

std::map<int, ExternalAxis> external_axes(const std::vector<std::pair<std::string, std::string>>& named,
                                          const Robot& robot, const std::string& where) {
  std::map<int, ExternalAxis> axes;
  const std::vector<std::string> joints = joint_names(robot);
  for (const auto& [axis, joint] : named) {
    if (axis.size() != 2 || axis.front() != 'E' || axis.back() < '1' || axis.back() > '6') {
      throw InputError(where + ": " + shown(axis) + " is no external axis, expected E1 to E6");
    }
    const bool is_reversed = joint.starts_with('-');
    const std::string name = joint.substr(is_reversed ? 1 : 0);
    if (joint != kNotOfTheArm && std::find(joints.begin(), joints.end(), name) == joints.end()) {
      throw InputError(where + ": " + robot.source + " has no joint " + shown(joint) + ", expected none, or one of " +
                       comma_separated(joints));
    }
    axes[axis.back() - '0'] = {.joint = name, .is_reversed = is_reversed};
  }
  return axes;
}

std::vector<std::string> carrying_joints(const Controller& controller) {
  std::vector<std::string> joints;
  for (const auto& [number, axis] : controller.external_axes) {
    if (axis.joint != kNotOfTheArm) {
      joints.push_back(axis.joint);
    }
  }
  return joints;
}

ProgramFrames read_program_frames(const std::filesystem::path& file, const ProgramLanguage& language) {
  return lower_ending(file) == ".json" ? frames_of_json(file)
                                       : language.read_frames(read_text_file(file), file.string());
}

}  // namespace kdl_calibration
