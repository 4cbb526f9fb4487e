#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

/// X_BF for each column of `joint_values`, joint effects included: those that are functions of signals as far as these
/// are known, see effect_basis.
std::vector<Eigen::Isometry3d> flange_poses(const ErrorModel& model, const Estimate& estimate,
                                            const Eigen::MatrixXd& joint_values, const DriveSignals& signals = {});
/// X_BF for each configuration.
std::vector<Eigen::Isometry3d> flange_poses(const ErrorModel& model, const Estimate& estimate,
                                            const Measurements& measurements);

/// Where an observation is expected, in W [m]: f = X_WB X_BF t. `X_BF` has one pose per configuration.
Eigen::Vector3d predicted_point(const Estimate& estimate, const std::vector<Eigen::Isometry3d>& X_BF,
                                const Observation& observation);

/// Twist of a term's column, per unit of the joint's motion: the factor basis(q) is still to come.
ParameterTwist effect_twist(const ErrorModel& model, const EffectTerm& term);
/// Twists of the free chain columns (base, geometric, effects) at an estimate; those of the effects as effect_twist().
std::vector<ParameterTwist> chain_twists(const ErrorModel& model, const Estimate& estimate, const Unknowns& unknowns);

/// Jacobians of the predicted positions at one estimate. Keeps references to its arguments.
class PositionPredictor {
public:
  PositionPredictor(const ErrorModel& model, const Estimate& estimate, const Unknowns& unknowns);

  /// Of the position in W of every target at joint values q of which `signals` (of one column) are known: 3 x columns
  /// each, [m] per unit.
  std::vector<Matrix3Xd> jacobians(const Eigen::VectorXd& q, const DriveSignals& signals = {}) const;
  /// At a configuration of measurements.
  std::vector<Matrix3Xd> jacobians(const Measurements& measurements, Eigen::Index configuration) const;

private:
  const ErrorModel& model_;
  const Estimate& estimate_;
  const Unknowns& unknowns_;
  FoldedChain chain_;
  std::vector<ParameterTwist> twists_;
};

}  // namespace kdl_calibration
