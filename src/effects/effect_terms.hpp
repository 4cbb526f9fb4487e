#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "measurements/drive_signals.hpp"

namespace kdl_calibration {

/// The terms of a group that joint values (joints x N) can tell apart: each standardised by its mean and standard
/// deviation there. Terms that hardly vary, and terms that others of the same joint replace, are left out. Tables need
/// a range of 10 degrees or 20 mm.
/// Without `signals` (of the joint values) there are no terms of torques, directions of approach and circumstances.
///
/// Gravity. The torque about joint i is a_i · sum_l (p_l - o_i + R_l c_l) x m_l g over the later links l. Every p_l -
/// o_i is a sum of vectors that are constant in the links before l, so that for revolute joints the torque is a linear
/// function of a_i · (R_l e x g), l >= i, e = x, y, z: masses, centres and compliance need not be known.
/// Transverse. The same about the two axes across a_i (see z_onto), before the joint moves, from links l = i … i + 2:
/// the bearing's tilting moment.
/// Backlash. tanh of the torque that equal masses at the later joint frames exert, over 0.15 of its mean size; and the
/// sign of the joint's last motion.
/// Torque. The measured torque, and its tanh over 0.15 of its mean size. Throws InputError if only some configurations
/// have a joint's torque.
/// Coupling. The values of the two joints before, and sine and cosine of the last one.
/// Expansion. The temperature times the length of the link before the joint; the coefficient is the growth per length.
/// Drift. The temperature. Both take the temperature of the link before the joint (MovingJoint::links) where that link
/// has one of its own: it is the one that expands, and it carries the joint's housing, encoder and most of its gear, as
/// the joint moves from it. Otherwise they take that of the arm. Where neither is stated there is no term.
/// Payload. The torque of the stated mass at the model's payload_centre.
/// Ripple. ripple_search finds the frequency in the residuals; here 100 per turn in every joint, for simulated robots.
/// Tables. A Gaussian process of Matérn-3/2 covariance in the Hilbert-space basis of Solin and Särkkä (2020), of length
/// `length` [rad or m]; its functions are not scaled, so that `sigma` is the table's.
std::vector<EffectTerm> effect_terms(const ErrorModel& model, EffectGroup group, const Eigen::MatrixXd& joint_values,
                                     const DriveSignals& signals = {});
/// The gravity terms of the largest moments alone, for few data: those of at least 15 % of the largest, where the
/// masses are those that the URDF states, or else equal ones at all joint frames and the tip.
std::vector<EffectTerm> main_gravity_terms(const ErrorModel& model, std::vector<EffectTerm> terms);
/// `length`: for all joints, but at most half of a joint's measured range.
std::vector<EffectTerm> table_terms(const ErrorModel& model, const Eigen::MatrixXd& joint_values, double length);

/// The columns of an effect of the caller's own that joint values (joints x N) can tell apart, standardised as the
/// others. Throws InputError for a joint that the robot does not have, and what own_columns() refuses.
std::vector<EffectTerm> own_terms(const ErrorModel& model, const OwnEffect& own, const Eigen::MatrixXd& joint_values);

/// Sine and cosine of one revolute joint.
std::vector<EffectTerm> ripple_terms(const ErrorModel& model, const Eigen::MatrixXd& joint_values, std::size_t joint,
                                     double times_a_turn);

/// Torque (force for a prismatic joint) about every joint's axis from unit masses at each later joint frame and the
/// tip, for gravity 1: joints x N for joint values joints x N.
Eigen::MatrixXd gravity_torques(const ErrorModel& model, const Eigen::MatrixXd& joint_values);

/// Compliance of the joints under gravity with few terms. If the URDF states link masses, each revolute joint gets one
/// term, their torque. Otherwise it gets one for each distinct torque of a mass at a later joint frame or the tip.
/// Torques that are small, nearly constant or similar to another of the same joint are left out. Each is divided by its
/// largest value.
std::vector<EffectTerm> load_terms(const ErrorModel& model);

/// One gain per moving joint: `value` is the relative gain error.
std::vector<EffectTerm> gain_terms(const ErrorModel& model);

/// Both: the effects to expect of joints if nothing is known about them.
std::vector<EffectTerm> load_and_gain_terms(const ErrorModel& model);

/// 1 sigma of the geometric errors of an ordinary arm, of which nothing else is known.
constexpr Priors kOrdinaryErrors{.length = 1e-3, .angle = 1e-3};
/// 1 sigma of the value of such a term in an ordinary arm, of which nothing else is known [rad, m or per unit].
double ordinary_size(const EffectTerm& term);

}  // namespace kdl_calibration
