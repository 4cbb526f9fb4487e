#include "programs/arm_axes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

using Eigen::AngleAxisd;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double kSingular = 1e-5;  // [rad], or relative

}  // namespace

Matrix3d ArmAxes::turn(std::size_t joint, double angle) const {
  return AngleAxisd(angle, axes[joint].direction).toRotationMatrix();
}

Isometry3d ArmAxes::motion(std::size_t joint, double angle) const {
  const Vector3d& point = axes[joint].point;
  return Eigen::Translation3d(point) * AngleAxisd(angle, axes[joint].direction) * Eigen::Translation3d(-point);
}

Vector3d ArmAxes::meeting_point(std::size_t first) const {
  Matrix3d normal = Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (std::size_t i = first; i < axes.size(); ++i) {
    const Matrix3d projection = Matrix3d::Identity() - axes[i].direction * axes[i].direction.transpose();
    normal += projection;
    right += projection * axes[i].point;
  }
  return normal.ldlt().solve(right);
}

std::optional<ArmAxes> axes_of(const Robot& robot) {
  ArmAxes arm{.axes = {}, .flange = Isometry3d::Identity()};
  if (robot.joints.size() != arm.axes.size()) {
    return std::nullopt;
  }
  for (std::size_t i = 0; i < arm.axes.size(); ++i) {
    const MovingJoint& joint = robot.joints[i];
    if (joint.type == JointType::prismatic || joint.mimic) {
      return std::nullopt;
    }
    arm.flange = arm.flange * to_eigen(joint.origin);
    arm.axes[i] = {.point = arm.flange.translation(), .direction = arm.flange.linear() * to_eigen(joint.axis)};
  }
  arm.flange = arm.flange * to_eigen(robot.tip_origin);
  return arm;
}

TwoAngles angles_of(double a, double b, double c) {
  constexpr double kRounding = 1e-9;
  const double length = std::hypot(a, b);
  if (length < kSingular) {
    return {.any = std::abs(c) < kSingular};
  }
  if (std::abs(c) > length * (1.0 + kRounding)) {
    return {};
  }
  const double middle = std::atan2(b, a);
  const double half = std::acos(std::clamp(c / length, -1.0, 1.0));
  return {.values = {middle + half, middle - half}, .count = 2};
}

double in_one_turn(double angle) { return std::remainder(angle, 2.0 * std::numbers::pi); }

std::optional<double> angle_about(const Vector3d& axis, const Vector3d& from, const Vector3d& to) {
  const Vector3d a = across(from, axis);
  const Vector3d b = across(to, axis);
  if (std::min(a.norm(), b.norm()) < kSingular) {
    return std::nullopt;
  }
  return std::atan2(axis.dot(a.cross(b)), a.dot(b));
}

Vector3d across(const Vector3d& vector, const Vector3d& direction) {
  return vector - direction * direction.dot(vector);
}

TwoAngles shoulders(const ArmAxes& arm, const Vector3d& point, const Vector3d& target) {
  const Vector3d& first = arm[0].direction;
  const Vector3d& second = arm[1].direction;
  const Vector3d from_first = target - arm[0].point;
  return angles_of(second.dot(across(from_first, first)), -second.dot(first.cross(from_first)),
                   second.dot(point - arm[0].point) - first.dot(from_first) * first.dot(second));
}

std::vector<std::pair<double, double>> elbows(const ArmAxes& arm, const Vector3d& point, const Vector3d& target,
                                              bool& singular) {
  const Vector3d& axis = arm[1].direction;
  const Vector3d upper = across(arm[2].point - arm[1].point, axis);
  const Vector3d fore = across(point - arm[2].point, axis);
  const Vector3d reach = across(target - arm[1].point, axis);
  const double side = arm[2].direction.dot(axis);  // 1, or -1 where joint 3 counts the other way
  const TwoAngles third = angles_of(upper.dot(fore), side * upper.dot(axis.cross(fore)),
                                    0.5 * (reach.squaredNorm() - upper.squaredNorm() - fore.squaredNorm()));
  std::vector<std::pair<double, double>> result;
  for (std::size_t i = 0; i < third.count; ++i) {
    const double q3 = in_one_turn(third.values[i]);
    if (const std::optional<double> q2 = angle_about(axis, upper + arm.turn(2, q3) * fore, reach)) {
      result.emplace_back(*q2, q3);
    } else {
      singular = true;
    }
  }
  return result;
}

}  // namespace kdl_calibration
