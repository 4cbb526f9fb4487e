#include "programs/carrier.hpp"

#include <fmt/core.h>
#include <algorithm>

#include "base/degree.hpp"
#include "base/text.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {

using Eigen::Index;

Carrier::Carrier(const Robot& robot, const std::map<int, ExternalAxis>& axes) : axes_(axes) {
  constexpr std::size_t kArm = 6;
  std::vector<std::string> names = joint_names(robot);
  names.resize(names.size() - std::min(names.size(), kArm));
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto axis =
        std::find_if(axes.begin(), axes.end(), [&](const auto& each) { return each.second.joint == names[i]; });
    if (axis != axes.end()) {
      joints_.push_back({.axis = axis->first, .sign = axis->second.is_reversed ? -1.0 : 1.0, .joint = robot.joints[i]});
    }
  }
  const auto idle =
      std::count_if(axes.begin(), axes.end(), [](const auto& axis) { return axis.second.joint == kNotOfTheArm; });
  if (joints_.size() != names.size() || axes.size() != names.size() + static_cast<std::size_t>(idle)) {
    throw InputError(robot.source + ": the joints before the six of the arm are " +
                     (names.empty() ? "none" : comma_separated(names)) +
                     ", expected --external-axis E1=JOINT for each of them and no other joint");
  }
}

Robot Carrier::arm(Robot robot) const {
  robot.joints.erase(robot.joints.begin(), robot.joints.begin() + static_cast<std::ptrdiff_t>(joints_.size()));
  return robot;
}

CompensatedJoints Carrier::with(const ProgramPoint& point, const SixJoints& arm, const std::string& where) const {
  constexpr double kOneMillimetre = 1e-3;  // [m]
  CompensatedJoints q(static_cast<Index>(joints_.size()) + arm.size());
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    const Joint& each = joints_[i];
    const bool slides = each.joint.type == JointType::prismatic;
    const auto found = std::find_if(point.external.begin(), point.external.end(),
                                    [&](const ExternalValue& external) { return external.axis == each.axis; });
    if (found == point.external.end() || found->is_length.value_or(slides) != slides) {
      throw InputError(fmt::format("{}has no E{} in {}, expected that of joint {}", where, each.axis,
                                   slides ? "mm" : "deg", shown(each.joint.name)));
    }
    q[static_cast<Index>(i)] = each.sign * found->value * (slides ? kOneMillimetre : kDegree);
  }
  q.tail<6>() = arm;
  return q;
}

Eigen::Isometry3d Carrier::pose(const CompensatedJoints& q) const {
  Eigen::Isometry3d X_BC = Eigen::Isometry3d::Identity();
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    const MovingJoint& joint = joints_[i].joint;
    const Eigen::Vector3d axis = to_eigen(joint.axis);
    const double value = q[static_cast<Index>(i)];
    X_BC = X_BC * to_eigen(joint.origin);
    if (joint.type == JointType::prismatic) {
      X_BC = X_BC * Eigen::Translation3d(value * axis);
    } else {
      X_BC = X_BC * Eigen::AngleAxisd(value, axis);
    }
  }
  return X_BC;
}

}  // namespace kdl_calibration
