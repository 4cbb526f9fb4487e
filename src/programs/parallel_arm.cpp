#include "programs/parallel_arm.hpp"

#include <algorithm>

namespace kdl_calibration {

using Eigen::Isometry3d;
using Eigen::Vector3d;

std::optional<ParallelArm> ParallelArm::of(const Robot& robot) {
  constexpr double kParallel = 0.02;  // [rad]
  constexpr double kMeet = 5e-3;      // [m]
  std::optional<ArmAxes> arm = axes_of(robot);
  if (!arm) {
    return std::nullopt;
  }
  const Axis& second = (*arm)[1];
  for (const std::size_t i : {2U, 3U}) {
    Axis& axis = arm->axes[i];
    if (second.direction.cross(axis.direction).norm() > kParallel) {
      return std::nullopt;
    }
    // Nearly parallel axes have their common normals far away: take the points beside axis 2.
    axis.point -=
        axis.direction * second.direction.dot(axis.point - second.point) / second.direction.dot(axis.direction);
  }
  const ParallelArm result(*arm);
  const bool has_wrist = std::all_of(arm->axes.begin() + 4, arm->axes.end(), [&](const Axis& axis) {
    return across(result.wrist_ - axis.point, axis.direction).norm() < kMeet;
  });
  const auto is_across = [&](std::size_t a, std::size_t b) {
    return (*arm)[a].direction.cross((*arm)[b].direction).norm() > kParallel;
  };
  return has_wrist && is_across(0, 1) && is_across(3, 4) && is_across(4, 5) ? std::optional(result) : std::nullopt;
}

// Axes 2, 3 and 4 move nothing along their direction: that part of the wrist's place gives joint 1, that part of axis
// 6's direction joint 5. What is left is the arm of two links that brings axis 4 to its place.
ArmSolutions ParallelArm::solve(const Isometry3d& X_BF) const {
  const Vector3d& a2 = arm_[1].direction;
  const Vector3d& a5 = arm_[4].direction;
  const Vector3d& a6 = arm_[5].direction;
  const Isometry3d moved = X_BF * arm_.flange.inverse();
  const TwoAngles first = shoulders(arm_, wrist_, moved * wrist_);
  ArmSolutions solutions{.joint_values = {}, .singular = first.any};
  for (std::size_t i = 0; i < first.count; ++i) {
    SixJoints q = SixJoints::Zero();
    q[0] = in_one_turn(first.values[i]);
    const Isometry3d behind_first = arm_.motion(0, -q[0]) * moved;
    const TwoAngles fifth = angles_of(a2.dot(across(a6, a5)), a2.dot(a5.cross(a6)),
                                      a2.dot(behind_first.linear() * a6) - a5.dot(a6) * a5.dot(a2));
    solutions.singular = solutions.singular || fifth.any;
    for (std::size_t k = 0; k < fifth.count; ++k) {
      q[4] = in_one_turn(fifth.values[k]);
      add_elbows(behind_first, q, solutions);
    }
  }
  return solutions;
}

// Joints 6, 2, 3 and 4 for these values of joints 1 and 5.
void ParallelArm::add_elbows(const Isometry3d& behind_first, SixJoints q, ArmSolutions& solutions) const {
  const Vector3d& a2 = arm_[1].direction;
  const std::optional<double> sixth =
      angle_about(arm_[5].direction, behind_first.linear().transpose() * a2, arm_.turn(4, -q[4]) * a2);
  if (!sixth) {
    solutions.singular = true;
    return;
  }
  q[5] = *sixth;
  const Isometry3d fourth_link = behind_first * arm_.motion(5, -q[5]) * arm_.motion(4, -q[4]);
  for (const auto& [second, third] : elbows(arm_, arm_[3].point, fourth_link * arm_[3].point, solutions.singular)) {
    q[1] = second;
    q[2] = third;
    const Vector3d side = arm_[3].direction.unitOrthogonal();
    const Vector3d turned = (arm_.turn(1, q[1]) * arm_.turn(2, q[2])).transpose() * fourth_link.linear() * side;
    if (const std::optional<double> fourth = angle_about(arm_[3].direction, side, turned)) {
      q[3] = *fourth;
      solutions.joint_values.push_back(q);
    }
  }
}

}  // namespace kdl_calibration
