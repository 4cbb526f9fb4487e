#include "estimation/prediction.hpp"

#include "effects/joint_effects.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

std::vector<Isometry3d> flange_poses(const ErrorModel& model, const Estimate& estimate, const MatrixXd& joint_values,
                                     const DriveSignals& signals) {
  return flange_poses(folded(model, estimate.errors),
                      effective_joint_values(model, estimate.effects, joint_values, signals));
}

std::vector<Isometry3d> flange_poses(const ErrorModel& model, const Estimate& estimate,
                                     const Measurements& measurements) {
  return flange_poses(model, estimate, measurements.joint_values, measurements.signals);
}

Residual residual(const Reading& reading, const Isometry3d& X_WT) {
  const Vector3d f = X_WT.translation();
  Residual result{
      .position = measured_minus_predicted(reading, f), .directions = directions(reading, f), .rotation = {}};
  if (const auto* const pose = std::get_if<Pose>(&reading)) {
    result.rotation = rotation_log(X_WT.linear().transpose() * pose->orientation.toRotationMatrix());
  }
  return result;
}

Vector3d predicted_point(const Estimate& estimate, const std::vector<Isometry3d>& X_BF,
                         const Observation& observation) {
  return estimate.frames.base(static_cast<std::size_t>(observation.station)) *
         (X_BF[static_cast<std::size_t>(observation.configuration)] *
          estimate.frames.targets[static_cast<std::size_t>(observation.target)].X_FT.translation());
}

Vector3d measured_minus_predicted(const Observation& observation, const Estimate& estimate,
                                  const std::vector<Isometry3d>& X_BF) {
  return measured_minus_predicted(observation.reading, predicted_point(estimate, X_BF, observation));
}

std::vector<Vector3d> residuals_of(const ErrorModel& model, const Estimate& estimate,
                                   const Measurements& measurements) {
  const std::vector<Isometry3d> X_BF = flange_poses(model, estimate, measurements);
  std::vector<Vector3d> result;
  result.reserve(measurements.observations.size());
  for (const Observation& observation : measurements.observations) {
    result.push_back(measured_minus_predicted(observation, estimate, X_BF));
  }
  return result;
}

ParameterTwist effect_twist(const FoldedChain& chain, const EffectTerm& term) {
  const auto joint = static_cast<std::size_t>(term.index);
  ParameterTwist twist;
  twist.frame = term.index;
  if (term.axis == EffectAxis::along) {
    twist.linear = chain.links[joint].linear().transpose() * chain.stretches[joint];
    return twist;
  }
  twist.tilted = term.axis != EffectAxis::across_x;  // the folded chain's joints turn about x, then about y and z
  if (term.axis == EffectAxis::own) {
    (chain.prismatic[joint] ? twist.linear : twist.angular) = Vector3d::UnitZ();
  } else {
    twist.angular = term.axis == EffectAxis::across_x ? Vector3d::UnitX() : Vector3d::UnitY();
  }
  return twist;
}

std::vector<ParameterTwist> chain_twists(const ErrorModel& model, const FoldedChain& chain, const VectorXd& errors,
                                         const Unknowns& unknowns) {
  std::vector<ParameterTwist> twists;
  const std::vector<ParameterTwist> base = base_twists();
  for (const std::size_t i : unknowns.of(UnknownGroup::base)) {
    twists.push_back(base[i % 6]);
  }
  const std::vector<ParameterTwist> geometric = parameter_twists(model, errors, unknowns.geometric());
  twists.insert(twists.end(), geometric.begin(), geometric.end());
  for (const std::size_t d : unknowns.effects()) {
    twists.push_back(effect_twist(chain, model.effects[d]));
  }
  return twists;
}

PositionPredictor::PositionPredictor(const ErrorModel& model, const Estimate& estimate, const Unknowns& unknowns)
    : model_(model),
      estimate_(estimate),
      unknowns_(unknowns),
      chain_(folded(model, estimate.errors)),
      twists_(chain_twists(model, chain_, estimate.errors, unknowns)) {}

std::vector<Matrix3Xd> PositionPredictor::jacobians(const Measurements& measurements, Index configuration,
                                                    std::optional<std::size_t> station) const {
  return jacobians(measurements.joint_values.col(configuration), column(measurements.signals, configuration), station);
}

std::vector<Matrix3Xd> PositionPredictor::jacobians(const VectorXd& q, const DriveSignals& signals,
                                                    std::optional<std::size_t> station) const {
  const MatrixXd joints = effective_joint_values(model_, estimate_.effects, q, signals);
  Matrix6Xd chain;
  const Matrix3d R_WF = estimate_.frames.base(station.value_or(0)).linear() *
                        flange_jacobian(chain_, twists_, joints.col(0), chain).linear();
  const std::vector<std::size_t>& of_bases = unknowns_.of(UnknownGroup::base);
  const bool of_arm_or_station = model_.has_undetermined_bases || estimate_.frames.bases.size() > 1;
  for (std::size_t i = 0; of_arm_or_station && i < of_bases.size(); ++i) {
    if (!station || of_bases[i] / 6 != *station) {
      chain.col(static_cast<Index>(i)).setZero();
    }
  }
  if (!unknowns_.effects().empty()) {
    const MatrixXd basis = effect_basis(model_, q, signals);
    Index column = unknowns_.range(UnknownGroup::effects).first;
    for (const std::size_t d : unknowns_.effects()) {
      chain.col(column++) *= basis(static_cast<Index>(d), 0);
    }
  }
  std::vector<Matrix3Xd> jacobians;
  for (std::size_t k = 0; k < estimate_.frames.targets.size(); ++k) {
    Matrix3Xd& jacobian = jacobians.emplace_back(Matrix3Xd::Zero(3, unknowns_.size()));
    jacobian.leftCols(chain.cols()) =
        R_WF * (chain.topRows<3>() - skew(estimate_.frames.targets[k].X_FT.translation()) * chain.bottomRows<3>());
    for (std::size_t i = 0; i < 3; ++i) {
      if (const int column = unknowns_.target_columns(k)[i]; column >= 0) {
        jacobian.col(column) = R_WF.col(static_cast<Index>(i));
      }
    }
  }
  return jacobians;
}

}  // namespace kdl_calibration
