#pragma once

#include <Eigen/Core>
#include <compare>
#include <cstddef>
#include <kdl/chain.hpp>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "measurements/drive_signals.hpp"

namespace kdl_calibration {

/// Name of the terms that share a prior sigma: a group, one joint's table or one effect of the caller's own. "gravity",
/// "tables.3", "own.droop".
std::string size_name(const EffectTerm& term);

/// "gravity", "transverse", "gain", "backlash", "harmonics", "ripple", "tables", "torque", "coupling", "expansion",
/// "drift", "payload", "own".
const char* to_string(EffectGroup group);
/// "own", "x", "y", "along".
const char* to_string(EffectAxis axis);
/// The groups that can be asked for by name, which `own` is not.
std::optional<EffectGroup> effect_group(const std::string& name);
std::vector<std::string> effect_group_names();

/// What must be stated for a group; none: nothing.
std::optional<Circumstance> needed_circumstance(EffectGroup group);
/// Whether some effect needs it.
bool depend_on(const std::vector<EffectTerm>& effects, Circumstance circumstance);

/// Whether any temperature or payload is stated.
bool states_any(const Circumstances& circumstances);
/// The temperature of the link before the joint: its own, else that of the arm; NaN if neither is known.
double temperature_before(const MovingJoint& joint, const Circumstances& circumstances);
/// Whether the term is a function of the temperature of the link before its joint.
bool depends_on_temperature(const EffectTerm& term);

/// A group of effects on one joint about one of its axes.
struct EffectMotionKey {
  EffectGroup group = EffectGroup::gravity;
  int joint = 0;
  EffectAxis axis = EffectAxis::own;

  friend auto operator<=>(const EffectMotionKey&,
                          const EffectMotionKey&) = default;  // NOLINT(modernize-use-nullptr): false
};
/// Indices of the model's terms, grouped by what they move.
std::map<EffectMotionKey, std::vector<Eigen::Index>> terms_by_motion(const ErrorModel& model);

/// (raw(q) - mean) / scale of every term of the model: terms x N for joint values joints x N. 0 if the direction of
/// approach is unknown. Throws InputError if a required torque is missing.
Eigen::MatrixXd effect_basis(const ErrorModel& model, const Eigen::MatrixXd& joint_values,
                             const DriveSignals& signals = {});

/// Whether some term is a function of measured torques, so that the pose depends on more than the joint values.
bool needs_torques(const ErrorModel& model);

/// Whether the term needs a direction of approach that is unknown in this column of the signals.
bool misses_approach(const EffectTerm& term, const DriveSignals& signals, Eigen::Index column);

/// The table at joint value `q`, even in withheld ranges.
double table_value(const JointTable& table, double q);

/// Whether the term is a table that is withheld at joint value `q`.
bool is_withheld(const EffectTerm& term, double q);
/// Whether any term is withheld at joint values `q`.
bool withholds_tables(const ErrorModel& model, const Eigen::VectorXd& q);

constexpr std::size_t kFewJoints = 32;  ///< up to which the functions that say so allocate nothing

/// Size of a vector of effective joint values: one entry per joint, three if some term tilts, four if some expands a
/// link, see FoldedChain.
Eigen::Index motion_size(const ErrorModel& model);
/// The entry that the term moves.
Eigen::Index motion_entry(const ErrorModel& model, const EffectTerm& term);

/// The terms' addition to the joint values of one configuration without signals: `motion` (motion_size) [rad or m].
/// `values` holds one value per term. Allocates nothing for few joints. Without functions of the caller's own.
void effect_motion(const ErrorModel& model, const Eigen::VectorXd& values, const Eigen::Ref<const Eigen::VectorXd>& q,
                   Eigen::Ref<Eigen::VectorXd> motion);
/// The same of functions of the caller's own, each called once for all configurations: motion_size x N.
Eigen::MatrixXd own_motions(const ErrorModel& model, const Eigen::VectorXd& values,
                            const Eigen::MatrixXd& joint_values);
bool has_own_functions(const ErrorModel& model);

/// The joint values including effects, for the folded chain: motion_size x N, or joints x N if all values are zero.
/// `values` holds one value per term of the model; empty means none.
Eigen::MatrixXd effective_joint_values(const ErrorModel& model, const Eigen::VectorXd& values,
                                       const Eigen::MatrixXd& joint_values, const DriveSignals& signals = {});
/// The same with effect_basis(model, joint_values) computed before.
Eigen::MatrixXd effective_joint_values(const ErrorModel& model, const Eigen::VectorXd& values,
                                       const Eigen::MatrixXd& joint_values, const Eigen::MatrixXd& basis);

/// The robot's chain with the links before its moving joints longer by `stretches` [m], one for each joint, along the
/// nominal links of the model.
KDL::Chain stretched_chain(const ErrorModel& model, const KDL::Chain& chain, const Eigen::VectorXd& stretches);
/// The robot's chain with two tilt angles for each moving joint, as in FoldedChain.
KDL::Chain tilted_chain(const KDL::Chain& chain, const Eigen::VectorXd& tilts);

}  // namespace kdl_calibration
