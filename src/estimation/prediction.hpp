#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {

/// X_BF for each column of `joint_values`, joint effects included; see effect_basis for those of signals.
std::vector<Eigen::Isometry3d> flange_poses(const ErrorModel& model, const Estimate& estimate,
                                            const Eigen::MatrixXd& joint_values, const DriveSignals& signals = {});
/// X_BF for each configuration.
std::vector<Eigen::Isometry3d> flange_poses(const ErrorModel& model, const Estimate& estimate,
                                            const Measurements& measurements);

/// The predicted position of an observation, in W of its station [m]: f = X_WB X_BF t. `X_BF` has one pose per
/// configuration.
Eigen::Vector3d predicted_point(const Estimate& estimate, const std::vector<Eigen::Isometry3d>& X_BF,
                                const Observation& observation);

/// Measured minus predicted, of one reading.
struct Residual {
  Eigen::Vector3d position;    ///< [m] in W, see measured_minus_predicted of a reading
  Eigen::Matrix3d directions;  ///< the projector P onto the measured directions: d position = -P d(predicted position)
  /// [rad] log(R^T Z) in the target's frame, of a measured orientation Z and the predicted one R.
  std::optional<Eigen::Vector3d> rotation;
};
Residual residual(const Reading& reading, const Eigen::Isometry3d& X_WT);

/// Measured minus predicted position of a row [m], along its measured directions.
Eigen::Vector3d measured_minus_predicted(const Observation& observation, const Estimate& estimate,
                                         const std::vector<Eigen::Isometry3d>& X_BF);

/// The same for each row.
std::vector<Eigen::Vector3d> residuals_of(const ErrorModel& model, const Estimate& estimate,
                                          const Measurements& measurements);

/// Twist of a term's column per unit of the joint's motion; the caller multiplies it by basis(q).
ParameterTwist effect_twist(const FoldedChain& chain, const EffectTerm& term);
/// Twists of the free chain columns (base, geometric, effects) at an estimate; those of the effects as effect_twist().
std::vector<ParameterTwist> chain_twists(const ErrorModel& model, const FoldedChain& chain,
                                         const Eigen::VectorXd& errors, const Unknowns& unknowns);

/// Jacobians of the predicted positions at one estimate. Keeps references to its arguments.
class PositionPredictor {
public:
  PositionPredictor(const ErrorModel& model, const Estimate& estimate, const Unknowns& unknowns);

  /// Jacobian of each target's position in W at joint values q and `signals` (one column): 3 x columns, [m] per unit.
  /// If the model has stations it is that of the given one; without one, that of the position in the base, along the
  /// axes of the first station's W.
  std::vector<Matrix3Xd> jacobians(const Eigen::VectorXd& q, const DriveSignals& signals = {},
                                   std::optional<std::size_t> station = std::nullopt) const;
  /// The same at a configuration of the measurements.
  std::vector<Matrix3Xd> jacobians(const Measurements& measurements, Eigen::Index configuration,
                                   std::optional<std::size_t> station = std::nullopt) const;

private:
  const ErrorModel& model_;
  const Estimate& estimate_;
  const Unknowns& unknowns_;
  FoldedChain chain_;
  std::vector<ParameterTwist> twists_;
};

}  // namespace kdl_calibration
