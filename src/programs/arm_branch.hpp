#pragma once

#include <Eigen/Core>
#include <array>
#include <numbers>
#include <optional>

namespace kdl_calibration {

using SixJoints = Eigen::Matrix<double, 6, 1>;

/// Values of a joint [rad] between two bounds, one of which belongs to it.
struct JointInterval {
  double lower = 0.0;
  double upper = 0.0;
  bool closed_above = false;  ///< lower < q <= upper; else lower <= q < upper

  /// Whether a value that a text states with few digits may lie in it.
  bool contains(double value, double tolerance = 0.0) const {
    const bool is_above = closed_above ? value > lower - tolerance : value >= lower - tolerance;
    const bool is_below = closed_above ? value <= upper + tolerance : value < upper + tolerance;
    return is_above && is_below;
  }
};

/// What a program states about the joint values that reach a pose. An arm with a spherical wrist has eight solutions:
/// two of the shoulder, the elbow and the wrist each. Joints that turn further than once multiply them. Members that
/// are not set are not stated.
struct ArmBranch {
  std::optional<bool> front;           ///< the wrist on the same side of axis 1 as at the language's reference
  std::optional<bool> elbow_up;        ///< the elbow bent to the same side as there
  std::optional<bool> wrist_positive;  ///< the controller's joint 5 above zero, else zero or below
  std::array<std::optional<JointInterval>, 6> turns;  ///< where the controller's joints stand
};

}  // namespace kdl_calibration
