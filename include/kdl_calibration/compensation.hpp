#pragma once

// Joint values with which the calibrated arm reaches the pose that the nominal arm would have.
//
//     const Compensator compensator(load_calibration("result.json", robot));
//     const CompensatedPoint point = compensator.solve(q);
//     if (point.status == CompensationStatus::exact) std::cout << point.joint_values.transpose() << "\n";

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

enum class CompensationStatus : std::uint8_t {
  exact,           ///< the calibrated arm reaches the asked pose to 1e-10 m and rad
  position_only,   ///< near a wrist singularity: exact position, the orientation as near as `most_change` allows
  unreachable,     ///< out of reach, or only with a larger change of a joint than `most_change`
  out_of_limits,   ///< a joint limit is in the way
  branch_changed,  ///< only beyond a singularity of the arm, such as a straight elbow
  step_limited     ///< on a path: the correction would change by more than `most_step` since the point before
};

/// The name of the enumerator.
const char* to_string(CompensationStatus status);

struct CompensationOptions {
  /// [rad], or [m] for joints that slide: largest change of a joint against its nominal value; may be infinite.
  double most_change = 0.08726646259971647;  // 5 degrees
  /// Wherever a joint is held at a bound, not only near a wrist singularity, an exact position is preferred to the
  /// least squares of position and orientation.
  bool position_first = false;
  /// [rad] or [m]: largest difference of a joint's correction between a point of a path and the point before.
  double most_step = 0.0017453292519943296;  // 0.1 degrees
  /// Names of independent joints that keep their nominal values, such as a rail.
  std::vector<std::string> held = {};
};

/// With at most this many moving joints an arm can be compensated.
inline constexpr int kMostCompensatedJoints = 32;
using CompensatedJoints = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostCompensatedJoints, 1>;

struct CompensatedPoint {
  CompensationStatus status = CompensationStatus::unreachable;
  /// One per moving joint, mimic joints included [rad or m]. Unless `exact`, the best that the bounds allow: of a
  /// `position_only` point position first, else the least squares of position and orientation (1 m counts as 1 rad).
  CompensatedJoints joint_values;
  CompensatedJoints change;        ///< against the nominal joint values
  double position_error = 0.0;     ///< [m] of the calibrated arm's flange at these values, from the asked pose
  double orientation_error = 0.0;  ///< [rad]
};

/// Cheap to copy. Its functions may be called from several threads. With joint values they allocate nothing. They throw
/// InputError for joint values that CalibratedArm refuses, and for a pose that is no rotation and translation.
/// CalibratedArm::predict says how well a target's position is known at the joint values found.
class Compensator {
public:
  /// Throws InputError for a calibration that is not trusted, effects of measured torques, over 32 moving joints, a
  /// `most_change` that is not above 0, and a `held` name that no independent joint has.
  explicit Compensator(const Calibration& calibration, const CompensationOptions& options = {});
  // Moving copies, so that there is no empty one.
  Compensator(const Compensator&) = default;
  Compensator& operator=(const Compensator&) = default;
  ~Compensator() = default;

  /// The asked pose is that of the nominal robot at these joint values. Where several solutions are near, as for an arm
  /// of seven joints, that of least change is taken.
  CompensatedPoint solve(const Eigen::Ref<const Eigen::VectorXd>& q_nominal) const;

  /// The same on a path, for loops in real time: the correction of each joint differs by at most `most_step` from
  /// `previous.change`, that of the point before. Where solve(q_nominal) would differ by more, as at a straight wrist,
  /// the status is `step_limited` and the errors say what remains: position first, then the orientation. Later points
  /// approach solve(q_nominal) step by step. Throws InputError also for a previous point of another arm.
  CompensatedPoint solve(const Eigen::Ref<const Eigen::VectorXd>& q_nominal, const CompensatedPoint& previous) const;

  /// The asked pose is X_BF, the flange in the base frame. The nominal joint values are those of the nominal robot
  /// that are found from `seed`.
  CompensatedPoint solve(const Eigen::Isometry3d& X_BF, const Eigen::Ref<const Eigen::VectorXd>& seed) const;

  /// The same without a seed: from the middle of the limits, else from 31 configurations within them. Of the ways in
  /// which an arm can reach a pose this is one, not always that of the program.
  CompensatedPoint solve(const Eigen::Isometry3d& X_BF) const;

  /// [m] How far apart the commands for this pose are, at most, over the ways that the same starts find: nominal
  /// positions of the flange at the compensated joint values. 0 with a single way. A controller that arrives in another
  /// way misses by as much.
  double spread_of_ways(const Eigen::Isometry3d& X_BF) const;

  /// The pose of the nominal robot's flange at these joint values: a controller that is told this pose sets them.
  Eigen::Isometry3d nominal_pose(const Eigen::Ref<const Eigen::VectorXd>& q) const;

  /// Joint values of the nominal robot with its flange at X_BF, found from `seed`: those that a controller sets. None
  /// if it does not reach the pose within its limits.
  std::optional<CompensatedJoints> nominal_joint_values(const Eigen::Isometry3d& X_BF,
                                                        const Eigen::Ref<const Eigen::VectorXd>& seed) const;

  /// The pose of the calibrated robot's flange at these joint values.
  Eigen::Isometry3d calibrated_pose(const Eigen::Ref<const Eigen::VectorXd>& q) const;

private:
  struct Parts;
  std::shared_ptr<const Parts> parts_;
};

}  // namespace kdl_calibration
