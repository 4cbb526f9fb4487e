#include "programs/measuring_program.hpp"

#include <algorithm>
#include <vector>

#include "programs/controller_joints.hpp"

namespace kdl_calibration {
namespace {

// Letters, digits and underscores, at most as many as every controller takes; a letter first.
std::string as_name(std::string text, std::size_t most) {
  const auto is_allowed = [](unsigned char c) { return c < 128 && (std::isalnum(c) != 0 || c == '_'); };
  std::replace_if(
      text.begin(), text.end(), [&](unsigned char c) { return !is_allowed(c); }, '_');
  if (text.empty() || std::isalpha(static_cast<unsigned char>(text.front())) == 0) {
    text = "P" + text;
  }
  return text.substr(0, most);
}

// In a comment or a string of any language.
std::string as_label(std::string text) {
  constexpr std::size_t kMost = 24;
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < 32 || c > 126 || c == '"' || c == ';'; }, '_');
  return text.substr(0, kMost);
}

}  // namespace

std::string measuring_program(const Robot& robot, const MeasuringPlan& plan, const JointConvention* convention,
                              const ProgramLanguage& language, const std::string& name) {
  constexpr std::size_t kMostOfName = 24;
  const ControllerJoints joints(robot, convention, language);
  std::vector<MeasuringStop> stops;
  for (std::size_t i = 0; i < plan.configurations.size(); ++i) {
    const SixJoints values =
        joints.controller(plan.joint_values.col(static_cast<Eigen::Index>(i))) / language.angle_unit;
    MeasuringStop stop{.label = as_label(plan.configurations[i]), .joint_values = {}};
    std::copy(values.begin(), values.end(), stop.joint_values.begin());
    stops.push_back(stop);
  }
  return language.drive(as_name(name, kMostOfName), stops);
}

}  // namespace kdl_calibration
