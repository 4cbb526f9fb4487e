#pragma once

#include <Eigen/Core>
#include <compare>
#include <cstddef>
#include <kdl/chain.hpp>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/drive_signals.hpp"
#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

/// "gravity", "transverse", "gain", "backlash", "harmonics", "ripple", "tables", "torque".
const char* to_string(EffectGroup group);
/// "own", "x", "y".
const char* to_string(EffectAxis axis);
std::optional<EffectGroup> effect_group(const std::string& name);
std::vector<std::string> effect_group_names();

/// A group of effects on one joint about one of its axes.
struct MovedBy {
  EffectGroup group = EffectGroup::gravity;
  int joint = 0;
  EffectAxis axis = EffectAxis::own;

  friend auto operator<=>(const MovedBy&, const MovedBy&) = default;  // NOLINT(modernize-use-nullptr): false
};
/// The terms of the model by what they do: their places in its list.
std::map<MovedBy, std::vector<Eigen::Index>> terms_by_motion(const ErrorModel& model);

/// (raw(q) - mean) / scale of every term of the model: terms x N for joint values joints x N and what is known of them.
/// 0 where a direction of approach is not. Throws InputError where a torque is not that a term asks for.
Eigen::MatrixXd effect_basis(const ErrorModel& model, const Eigen::MatrixXd& joint_values,
                             const DriveSignals& signals = {});

/// Whether some term is a function of measured torques, so that joint values alone do not tell where the arm stands.
bool needs_torques(const ErrorModel& model);

/// Whether the term asks for a direction of approach that is not known at this column of the signals.
bool misses_approach(const EffectTerm& term, const DriveSignals& signals, Eigen::Index column);

/// A table's function at its joint's value, also where it is withheld.
double table_value(const JointTable& table, double q);

/// Whether the measurements tell too little of the term's table at its joint's value.
bool is_withheld(const EffectTerm& term, double q);
/// Whether that is so of any term.
bool withholds_tables(const ErrorModel& model, const Eigen::VectorXd& q);

constexpr std::size_t kFewJoints = 32;  ///< with which nothing is allocated where so promised

/// Entries of a vector of joint values that the model's terms move: one a joint, or three where some tilt, see
/// FoldedChain.
Eigen::Index motion_size(const ErrorModel& model);
/// The one that the term moves.
Eigen::Index motion_entry(const ErrorModel& model, const EffectTerm& term);

/// What the terms add to the joint values at one configuration of which nothing else is known: `motion` (motion_size)
/// [rad or m]. `values` holds one value per term. Allocates nothing for few joints.
void effect_motion(const ErrorModel& model, const Eigen::VectorXd& values, const Eigen::Ref<const Eigen::VectorXd>& q,
                   Eigen::Ref<Eigen::VectorXd> motion);

/// The joint values that the folded chain needs to stand where the real one does: motion_size x N, or joints x N where
/// all values are zero. `values` holds one value per term of the model; empty means none.
Eigen::MatrixXd effective_joint_values(const ErrorModel& model, const Eigen::VectorXd& values,
                                       const Eigen::MatrixXd& joint_values);
Eigen::MatrixXd effective_joint_values(const ErrorModel& model, const Eigen::VectorXd& values,
                                       const Eigen::MatrixXd& joint_values, const DriveSignals& signals);
/// The same where effect_basis(model, joint_values) is at hand.
Eigen::MatrixXd effective_joint_values(const ErrorModel& model, const Eigen::VectorXd& values,
                                       const Eigen::MatrixXd& joint_values, const Eigen::MatrixXd& basis);

/// The robot's chain with its moving joints tilted by two angles each, as FoldedChain says.
KDL::Chain tilted_chain(const KDL::Chain& chain, const Eigen::VectorXd& tilts);

}  // namespace kdl_calibration
