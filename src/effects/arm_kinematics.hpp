#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "kdl_calibration/error_model.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {

/// Forward kinematics of the calibrated arm, effects included, for repeated calls: everything independent of the joint
/// values is prepared once. Thread-safe. With up to 32 joints calls allocate nothing, except to resize a Jacobian.
class ArmKinematics {
public:
  /// The model of a calibration, fitted or read back, with the `errors` and `effects` of its estimate; an empty vector
  /// means no effects. Throws InputError for values that are not finite, and effects of measured torques (see
  /// flange_poses). The direction of approach counts as unknown.
  ArmKinematics(const ErrorModel& model, const Eigen::VectorXd& errors, const Eigen::VectorXd& effects);

  Eigen::Index joints() const { return static_cast<Eigen::Index>(model_.joints.size()); }

  /// X_BF at joint values `q`, as measurements give them: one per joint, mimic joints included [rad or m].
  Eigen::Isometry3d flange_pose(const Eigen::Ref<const Eigen::VectorXd>& q) const;

  /// The same; fills `jacobian` (6 x joints) with the flange's twist in the base frame per unit of each of these
  /// values: linear velocity of the flange's origin, then angular velocity. It includes the derivatives of the effects,
  /// by central differences (error below 1e-8). The pose jumps where a joint enters a range in which its table is
  /// withheld.
  Eigen::Isometry3d flange_pose(const Eigen::Ref<const Eigen::VectorXd>& q, Matrix6Xd& jacobian) const;
  /// The same into a Jacobian of the right size.
  Eigen::Isometry3d flange_pose(const Eigen::Ref<const Eigen::VectorXd>& q, Eigen::Ref<Matrix6Xd> jacobian) const;

private:
  ErrorModel model_;
  Eigen::VectorXd effects_;  // one per term; empty if all are zero
  FoldedChain chain_;
  bool has_own_functions_ = false;
};

}  // namespace kdl_calibration
