#pragma once

#include <Eigen/Geometry>
#include <optional>

#include "kdl_calibration/robot.hpp"
#include "programs/arm_axes.hpp"

namespace kdl_calibration {

/// Inverse kinematics in closed form of the arms of Universal Robots: six revolute joints, axes 2, 3 and 4 parallel,
/// the last two through one point. Where a robot's own calibration tilts the axes by some milliradians, the solutions
/// are seeds of its own ones.
class ParallelArm {
public:
  /// None for an arm of other build.
  static std::optional<ParallelArm> of(const Robot& robot);

  /// All solutions for the flange in the base frame.
  ArmSolutions solve(const Eigen::Isometry3d& X_BF) const;

private:
  explicit ParallelArm(const ArmAxes& arm) : arm_(arm), wrist_(arm.meeting_point(4)) {}
  void add_elbows(const Eigen::Isometry3d& behind_first, SixJoints q, ArmSolutions& solutions) const;

  ArmAxes arm_;
  Eigen::Vector3d wrist_;  // where the last two axes meet, all joints at zero
};

}  // namespace kdl_calibration
