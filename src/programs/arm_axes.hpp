#pragma once

// The axes of an arm, and the subproblems of its inverse kinematics (B. Paden, 1986).

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "kdl_calibration/robot.hpp"
#include "programs/arm_branch.hpp"

namespace kdl_calibration {

/// Joint values that reach a pose, each from -pi to pi. None where it is out of reach. At a singularity infinitely many
/// exist: `singular` is true, and none of them is given.
struct ArmSolutions {
  std::vector<SixJoints> joint_values;
  bool singular = false;
};

struct Axis {
  Eigen::Vector3d point;
  Eigen::Vector3d direction;
};

/// Six revolute joints in the base frame, all of them at zero.
struct ArmAxes {
  std::array<Axis, 6> axes;
  Eigen::Isometry3d flange;

  const Axis& operator[](std::size_t joint) const { return axes[joint]; }
  /// The rotation about the direction of a joint's axis.
  Eigen::Matrix3d turn(std::size_t joint, double angle) const;
  /// The motion of what stands behind a joint.
  Eigen::Isometry3d motion(std::size_t joint, double angle) const;
  /// The point next to the last axes, from `first` on, by least squares.
  Eigen::Vector3d meeting_point(std::size_t first) const;
};

/// None for an arm that has not six revolute joints of its own.
std::optional<ArmAxes> axes_of(const Robot& robot);

/// The angles x with a cos x + b sin x = c.
struct TwoAngles {
  std::array<double, 2> values{};
  std::size_t count = 0;  ///< 0: no solution; 1: both are one
  bool any = false;       ///< every angle is a solution
};
TwoAngles angles_of(double a, double b, double c);

/// From -pi to pi.
double in_one_turn(double angle);

/// The angle of the rotation about `axis` that takes `from` to `to`; none where they lie on the axis.
std::optional<double> angle_about(const Eigen::Vector3d& axis, const Eigen::Vector3d& from, const Eigen::Vector3d& to);

/// What is left of a vector across a direction of length 1.
Eigen::Vector3d across(const Eigen::Vector3d& vector, const Eigen::Vector3d& direction);

/// The values of joint 1 at which `target` is as far along axis 2 as `point`, with joint 1 at zero, is.
TwoAngles shoulders(const ArmAxes& arm, const Eigen::Vector3d& point, const Eigen::Vector3d& target);

/// The values of joints 2 and 3, whose axes are parallel, that bring `point` to `target`, both with joint 1 at zero.
std::vector<std::pair<double, double>> elbows(const ArmAxes& arm, const Eigen::Vector3d& point,
                                              const Eigen::Vector3d& target, bool& singular);

}  // namespace kdl_calibration
