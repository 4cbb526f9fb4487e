#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/kinematics.hpp"

namespace kdl_calibration {

/// The arm as it was calibrated, effects included, for programs that ask often: what does not depend on the joint
/// values is prepared once. Any number of threads may ask the same arm. With up to 32 joints nothing is allocated, but
/// for a Jacobian that has not its size yet.
class CalibratedArm {
public:
  /// The model of a calibration, fitted or read back, with the `errors` and `effects` of its estimate; no effects mean
  /// none. Throws InputError where these are not one for each parameter and term, or not finite, and where effects are
  /// functions of measured torques (see flange_poses). The direction of approach is not known.
  CalibratedArm(const ErrorModel& model, const Eigen::VectorXd& errors, const Eigen::VectorXd& effects);

  Eigen::Index joints() const { return static_cast<Eigen::Index>(model_.joints.size()); }

  /// X_BF at joint values `q`, as measurements give them: one per joint, joints that follow others included [rad or m].
  /// Throws InputError where there are more or fewer.
  Eigen::Isometry3d flange_pose(const Eigen::Ref<const Eigen::VectorXd>& q) const;

  /// And in `jacobian` (6 x joints) the flange's twist in the base frame per unit of each of these values: linear
  /// velocity of the flange's origin, then angular velocity. What a value does to the effects is part of it, by central
  /// differences (below 1e-8). The pose itself has a step where a joint comes to a range in which its table is
  /// withheld.
  Eigen::Isometry3d flange_pose(const Eigen::Ref<const Eigen::VectorXd>& q, Matrix6Xd& jacobian) const;

private:
  ErrorModel model_;
  Eigen::VectorXd effects_;  // one per term; none where all are zero
  FoldedChain chain_;
};

}  // namespace kdl_calibration
