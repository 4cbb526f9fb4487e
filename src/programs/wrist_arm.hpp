#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "kdl_calibration/robot.hpp"
#include "programs/arm_axes.hpp"

namespace kdl_calibration {

/// Which of the two solutions of shoulder and elbow.
struct ArmPosture {
  bool front = true;     ///< the wrist on the same side of axis 1 as at `zero`
  bool elbow_up = true;  ///< the elbow bent to the same side as at `zero`

  bool operator==(const ArmPosture&) const = default;
};

/// Inverse kinematics in closed form of the usual industrial arm: six revolute joints, axes 2 and 3 parallel, the last
/// three axes through one point. D. L. Pieper, 1968; angles by the subproblems of B. Paden, 1986.
class WristArm {
public:
  /// None for an arm of other build. Its postures are counted from an unstated one.
  static std::optional<WristArm> of(const Robot& robot);

  /// `zero` is the posture that counts as in front and up. Throws InputError for an arm of other build, and where
  /// `zero` is singular.
  WristArm(const Robot& robot, const SixJoints& zero);

  /// All solutions for the flange in the base frame.
  ArmSolutions solve(const Eigen::Isometry3d& X_BF) const;

  ArmPosture posture(const SixJoints& q) const;

private:
  struct Sides {
    double shoulder = 1.0;  // [m] of the wrist from the plane of axis 1 and the direction of axis 2
    double elbow = 1.0;     // [m^2] area that upper arm and forearm span
  };

  explicit WristArm(const ArmAxes& arm) : arm_(arm), wrist_(arm.meeting_point(3)) {}
  Sides sides(const SixJoints& q) const;
  void add_wrists(const Eigen::Matrix3d& wrist, SixJoints q, ArmSolutions& solutions) const;

  ArmAxes arm_;
  Eigen::Vector3d wrist_;  // where the last three axes meet, all joints at zero
  Sides zero_;
};

}  // namespace kdl_calibration
