#include "robot/joint_ranges.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/number_range.hpp"
#include "base/number_text.hpp"
#include "base/preconditions.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {

JointRanges limits_of(const std::vector<MovingJoint>& joints) {
  JointRanges ranges;
  for (const MovingJoint& joint : joints) {
    const double whole = joint.type == JointType::prismatic ? 1.0 : std::numbers::pi;
    ranges.emplace_back(joint.lower.value_or(-whole), joint.upper.value_or(whole));
  }
  return ranges;
}

JointRanges published_ranges(const std::vector<MovingJoint>& joints) {
  JointRanges ranges(joints.size(), {-std::numbers::pi, std::numbers::pi});
  const std::vector<std::size_t> independent = independent_joints(joints);
  for (std::size_t i = 0; i < std::min<std::size_t>(4, independent.size()); ++i) {
    ranges[independent[i]] = {-std::numbers::pi / 2.0, std::numbers::pi / 2.0};
  }
  return ranges;
}

Eigen::MatrixXd random_configurations(const JointRanges& ranges, int count, Random& random) {
  require_at_least("configurations", count, 0);
  for (const auto& [lower, upper] : ranges) {
    require_finite("a joint range", std::isfinite(lower) && std::isfinite(upper));
    if (std::max(std::abs(lower), std::abs(upper)) > kLargestNumber) {
      refuse_input("a joint range from " + shortest(lower) + " to " + shortest(upper), "one within 1e12");
    }
    if (!(lower <= upper)) {
      refuse_input("a joint range from " + shortest(lower) + " to " + shortest(upper), "the lower end first");
    }
  }
  Eigen::MatrixXd joint_values(static_cast<Eigen::Index>(ranges.size()), count);
  for (Eigen::Index c = 0; c < count; ++c) {
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      joint_values(static_cast<Eigen::Index>(i), c) = random.uniform(ranges[i].first, ranges[i].second);
    }
  }
  return joint_values;
}

Eigen::MatrixXd random_configurations(const std::vector<MovingJoint>& joints, const JointRanges& ranges, int count,
                                      Random& random) {
  Eigen::MatrixXd joint_values = random_configurations(ranges, count, random);
  follow(joints, joint_values);
  return joint_values;
}

}  // namespace kdl_calibration
