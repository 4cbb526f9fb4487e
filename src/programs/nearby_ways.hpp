#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/robot.hpp"
#include "programs/parallel_arm.hpp"
#include "programs/wrist_arm.hpp"

namespace kdl_calibration {

/// The ways in which an arm reaches a pose, for controllers that take the one next to where the arm is. How they
/// measure that is not documented: here it is the norm of the differences of joint values.
class NearbyWays {
public:
  explicit NearbyWays(const Robot& arm);

  /// Whether the ways are known in closed form: a spherical wrist, or the arms of Universal Robots.
  bool are_known() const { return wrist_ || parallel_; }

  /// Joint values within the limits for the flange in the base frame, those next to `near` first: of each solution the
  /// turns next to `near`, and those with a joint a turn further.
  std::vector<SixJoints> all(const Eigen::Isometry3d& X_BF, const SixJoints& near) const;

private:
  bool is_within_limits(const SixJoints& q) const;

  std::vector<MovingJoint> joints_;
  std::optional<WristArm> wrist_;
  std::optional<ParallelArm> parallel_;
};

/// A controller may measure distances otherwise: another way that is less than so many times as far may be its choice.
inline constexpr double kAboutAsNear = 2.0;

/// Of these ways those that are no farther from `near` than `share` times the `taken` one, but for this one.
std::vector<SixJoints> other_ways(std::vector<SixJoints> ways, const SixJoints& near, const SixJoints& taken,
                                  double share);

/// [m] How far the command for the pose is, at most, from the one that was taken where the arm reaches it from these
/// nominal joint values.
double spread_of_commands(const Compensator& compensator, const Eigen::Isometry3d& X_BF, const CompensatedPoint& taken,
                          const std::vector<CompensatedJoints>& others);

}  // namespace kdl_calibration
