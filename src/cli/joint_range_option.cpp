#include "cli/joint_range_option.hpp"

#include <algorithm>
#include <utility>

#include "base/degree.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/joint_ranges.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::cli {
namespace {

// Parses "lower:upper" in degrees, or millimetres for a prismatic joint.
std::pair<double, double> parsed_range(const std::string& text, const MovingJoint& joint) {
  const bool prismatic = joint.type == JointType::prismatic;
  const std::size_t colon = text.find(':');
  const auto lower = parsed_number(text.substr(0, colon));
  const auto upper = colon == std::string::npos ? std::nullopt : parsed_number(text.substr(colon + 1));
  if (!lower || !upper || *lower > *upper) {
    throw InputError("--joint-ranges: '" + text + "' for " + joint.name + " is no range, expected lower:upper in " +
                     (prismatic ? "millimetres" : "degrees"));
  }
  const double unit = prismatic ? 1e-3 : kDegree;
  return {*lower * unit, *upper * unit};
}

}  // namespace

JointRanges joint_ranges(const ErrorModel& model, const std::vector<std::string>& given) {
  const std::vector<std::size_t> joints = independent_joints(model.joints);
  if (given.size() == 1 && given.front() == "limits") {
    return limits_of(model.joints);
  }
  if (given.size() == 1 && given.front() == "published") {
    const bool six_revolute = joints.size() == 6 && std::none_of(joints.begin(), joints.end(), [&](std::size_t i) {
                                return model.joints[i].type == JointType::prismatic;
                              });
    if (!six_revolute) {
      throw InputError("--joint-ranges: 'published' is for six revolute joints, expected limits or lower:upper of " +
                       std::to_string(joints.size()) + " joints");
    }
    return published_ranges(model.joints);
  }
  if (given.size() != joints.size()) {
    throw InputError("--joint-ranges: has " + std::to_string(given.size()) +
                     " entries, expected limits, published or " + std::to_string(joints.size()) + " times lower:upper");
  }
  JointRanges ranges = limits_of(model.joints);
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const MovingJoint& joint = model.joints[joints[i]];
    const Drive drive = drive_of(joint);
    auto [lower, upper] = parsed_range(given[i], joint);
    lower = drive.multiplier * lower + drive.offset;
    upper = drive.multiplier * upper + drive.offset;
    ranges[joints[i]] = std::minmax({lower, upper});
  }
  return ranges;
}

}  // namespace kdl_calibration::cli
