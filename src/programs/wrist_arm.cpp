#include "programs/wrist_arm.hpp"

#include <algorithm>
#include <cmath>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kParallel = 1e-3;  // [rad]
constexpr double kMeet = 1e-3;      // [m]

bool has_wrist(const ArmAxes& arm) {
  if (arm[1].direction.cross(arm[2].direction).norm() > kParallel ||
      arm[3].direction.cross(arm[4].direction).norm() < kParallel) {
    return false;
  }
  const Vector3d wrist = arm.meeting_point(3);
  return std::all_of(arm.axes.begin() + 3, arm.axes.end(),
                     [&](const Axis& axis) { return across(wrist - axis.point, axis.direction).norm() < kMeet; });
}

ArmAxes checked_axes(const Robot& robot) {
  const std::optional<ArmAxes> arm = axes_of(robot);
  if (!arm || !has_wrist(*arm)) {
    throw InputError(robot.source +
                     ": the arm is of another build, expected six revolute joints, axes 2 and 3 parallel, and the "
                     "last three axes through one point");
  }
  return *arm;
}

}  // namespace

std::optional<WristArm> WristArm::of(const Robot& robot) {
  const std::optional<ArmAxes> arm = axes_of(robot);
  return arm && has_wrist(*arm) ? std::optional(WristArm(*arm)) : std::nullopt;
}

WristArm::WristArm(const Robot& robot, const SixJoints& zero) : WristArm(checked_axes(robot)) {
  zero_ = sides(zero);
  if (std::min(std::abs(zero_.shoulder), std::abs(zero_.elbow)) < kMeet) {
    throw InputError(robot.source +
                     ": the arm is of another build, expected a wrist beside axis 1 and a bent elbow "
                     "where the controller counts it as in front and up");
  }
}

WristArm::Sides WristArm::sides(const SixJoints& q) const {
  const Vector3d& a2 = arm_[1].direction;
  const Vector3d upper = arm_[2].point - arm_[1].point;
  const Vector3d fore = arm_.turn(2, q[2]) * (wrist_ - arm_[2].point);
  const Vector3d wrist = arm_[1].point + arm_.turn(1, q[1]) * (upper + fore);
  return {.shoulder = a2.dot(arm_[0].direction.cross(wrist - arm_[0].point)), .elbow = a2.dot(upper.cross(fore))};
}

ArmPosture WristArm::posture(const SixJoints& q) const {
  const Sides now = sides(q);
  return {.front = now.shoulder * zero_.shoulder > 0.0, .elbow_up = now.elbow * zero_.elbow > 0.0};
}

// Adds both solutions of the last three joints, whose rotations multiply to `wrist`.
void WristArm::add_wrists(const Matrix3d& wrist, SixJoints q, ArmSolutions& solutions) const {
  const Vector3d& a4 = arm_[3].direction;
  const Vector3d& a5 = arm_[4].direction;
  const Vector3d& a6 = arm_[5].direction;
  const TwoAngles fifth =
      angles_of(a4.dot(across(a6, a5)), a4.dot(a5.cross(a6)), a4.dot(wrist * a6) - a5.dot(a6) * a5.dot(a4));
  solutions.singular = solutions.singular || fifth.any;
  for (std::size_t i = 0; i < fifth.count; ++i) {
    q[4] = in_one_turn(fifth.values[i]);
    const std::optional<double> fourth = angle_about(a4, arm_.turn(4, q[4]) * a6, wrist * a6);
    const std::optional<double> sixth = angle_about(a6, wrist.transpose() * a4, arm_.turn(4, -q[4]) * a4);
    if (!fourth || !sixth) {
      solutions.singular = true;
      return;
    }
    q[3] = *fourth;
    q[5] = *sixth;
    solutions.joint_values.push_back(q);
  }
}

// Turned back about axis 1, the wrist lies in the plane in which axes 2 and 3 move it.
ArmSolutions WristArm::solve(const Eigen::Isometry3d& X_BF) const {
  const Eigen::Isometry3d moved = X_BF * arm_.flange.inverse();
  const TwoAngles first = shoulders(arm_, wrist_, moved * wrist_);
  ArmSolutions solutions{.joint_values = {}, .singular = first.any};
  for (std::size_t i = 0; i < first.count; ++i) {
    SixJoints q = SixJoints::Zero();
    q[0] = in_one_turn(first.values[i]);
    const Eigen::Isometry3d behind_first = arm_.motion(0, -q[0]) * moved;
    for (const auto& [second, third] : elbows(arm_, wrist_, behind_first * wrist_, solutions.singular)) {
      q[1] = second;
      q[2] = third;
      const Matrix3d arm = arm_.turn(1, q[1]) * arm_.turn(2, q[2]);
      add_wrists(arm.transpose() * behind_first.linear(), q, solutions);
    }
  }
  return solutions;
}

}  // namespace kdl_calibration
