#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <vector>

#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

using SixJoints = Eigen::Matrix<double, 6, 1>;

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
  /// `zero` is the posture that counts as in front and up. Throws InputError for an arm of other build, and where
  /// `zero` is singular.
  WristArm(const Robot& robot, const SixJoints& zero);

  /// All solutions for the flange in the base frame, each value from -pi to pi. None where the pose is out of reach;
  /// at a singularity, where infinitely many exist, `singular` is true and none is given.
  struct Solutions {
    std::vector<SixJoints> joint_values;
    bool singular = false;
  };
  Solutions solve(const Eigen::Isometry3d& X_BF) const;

  ArmPosture posture(const SixJoints& q) const;

private:
  struct Axis {
    Eigen::Vector3d point;  // in the base frame with all joints at zero
    Eigen::Vector3d direction;
  };
  struct Sides {
    double shoulder;  // [m] of the wrist from the plane of axis 1 and the direction of axis 2
    double elbow;     // [m^2] area that upper arm and forearm span
  };

  Eigen::Matrix3d turn(std::size_t joint, double angle) const;
  Sides sides(const SixJoints& q) const;
  void add_wrists(const Eigen::Matrix3d& wrist, SixJoints q, Solutions& solutions) const;

  std::array<Axis, 6> axes_;
  Eigen::Vector3d wrist_;     // where the last three axes meet, all joints at zero
  Eigen::Isometry3d flange_;  // all joints at zero
  Sides zero_;
};

}  // namespace kdl_calibration
