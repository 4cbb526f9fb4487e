#include "measurements/missing_units.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/number_text.hpp"
#include "base/text.hpp"

namespace kdl_calibration {
namespace {

std::string rounded(double value) { return shortest(std::round(value)); }

// [rad] Two turns, or twice the widest limit.
double largest_angle(const ExpectedJoints& joints) {
  double largest = 2.0 * std::numbers::pi;
  for (const MovingJoint& joint : joints.joints) {
    if (joint.type != JointType::prismatic) {
      largest = std::max({largest, std::abs(joint.lower.value_or(0.0)), std::abs(joint.upper.value_or(0.0))});
    }
  }
  return 2.0 * largest;
}

// [m] Twenty times the reach of the arm with a tool of one metre.
double largest_length(const ExpectedJoints& joints) {
  double reach = 1.0;
  for (const MovingJoint& joint : joints.joints) {
    reach += joint.origin.p.Norm();
    if (joint.type == JointType::prismatic) {
      reach += std::max({1.0, std::abs(joint.lower.value_or(0.0)), std::abs(joint.upper.value_or(0.0))});
    }
  }
  return 20.0 * reach;
}

void check_units_of_points(const ExpectedJoints& joints, const ReadValues& read) {
  if (read.header.distance.unit == Unit::none && read.largest_distance > largest_length(joints)) {
    fail(read.source, "distances up to " + rounded(read.largest_distance) +
                          " m without a unit are beyond this robot: millimetres? write distance[mm] (or [m])");
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const bool by_axis = present(read.header.position[axis]);
    const Column& column = by_axis ? read.header.position[axis] : read.header.along;
    if (!present(column) || column.unit != Unit::none) continue;
    const double apart = read.points.sizes()[static_cast<Eigen::Index>(axis)];
    if (apart > largest_length(joints)) {
      const std::string axis_name(1, "xyz"[axis]);
      const std::string name = by_axis ? axis_name : "along";
      fail(read.source, "points " + rounded(apart) + " m apart along " + axis_name +
                            " without a unit are beyond this robot: millimetres? write " + name + "[mm] (or [m])");
    }
  }
}

}  // namespace

void check_missing_units(const ExpectedJoints& joints, const ReadValues& read) {
  if (!joints.kinds_known) return;
  for (std::size_t j = 0; j < read.header.joints.size() && read.joint_values.size() > 0; ++j) {
    if (read.header.joints[j].unit != Unit::none) continue;
    const double largest = read.joint_values.row(static_cast<Eigen::Index>(j)).cwiseAbs().maxCoeff();
    const ValueKind kind = kind_of_value(joints, j);
    const std::string& name = joints.names[j];
    if (kind == ValueKind::angle && largest > largest_angle(joints)) {
      fail(read.source, "joint values of " + shown(name) + " up to " + shortest(largest) +
                            " without a unit are no radians: degrees? write " + printable(name) + "[deg] (or [rad])");
    }
    if (kind == ValueKind::length && largest > largest_length(joints)) {
      fail(read.source, "joint values of " + shown(name) + " up to " + shortest(largest) +
                            " without a unit are no metres: millimetres? write " + printable(name) + "[mm] (or [m])");
    }
  }
  check_units_of_points(joints, read);
}

}  // namespace kdl_calibration
