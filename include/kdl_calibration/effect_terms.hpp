#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "kdl_calibration/drive_signals.hpp"
#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

/// The terms of a group that joint values (joints x N) can tell apart: each less its mean over them, over its standard
/// deviation. Left out are those that hardly change there and those that others of the same joint say as well; a table
/// only where the joint moves by 10 degrees or 20 mm.
/// `signals` are those of the joint values, without which there are no terms of torques and of directions of approach.
///
/// Gravity. The torque about joint i is a_i · sum_l (p_l - o_i + R_l c_l) x m_l g over the later links l. Every
/// p_l - o_i is a sum of vectors that are constant in the links before l, so that for revolute joints the torque is a
/// linear function of a_i · (R_l e x g), l >= i, e = x, y, z: masses, centres and compliance need not be known.
/// Transverse. The same across the axis, about the two directions of z_onto(a_i) before the joint moves, of the links
/// l = i … i + 2: what its bearing feels.
/// Backlash. tanh of the torque that equal masses at the later joint frames exert, over 0.15 of its mean size; and the
/// sign of the joint's last motion.
/// Torque. The measured torque, and its tanh over 0.15 of its mean size. Throws InputError where some configurations
/// have the torque of a joint and others have not.
/// Ripple. How often a turn is found by a search in what the other terms leave; here hundred times in every joint, as
/// for robots that are simulated.
/// Tables. A Gaussian process of Matérn-3/2 covariance in the Hilbert-space basis of Solin and Särkkä (2020), of length
/// `length` [rad or m]; its functions are not scaled, so that `sigma` is that of the table.
std::vector<EffectTerm> effect_terms(const ErrorModel& model, EffectGroup group, const Eigen::MatrixXd& joint_values,
                                     const DriveSignals& signals = {});
/// `length`: of all joints, at most half of what each moves.
std::vector<EffectTerm> table_terms(const ErrorModel& model, const Eigen::MatrixXd& joint_values, double length);

/// Sine and cosine of one revolute joint.
std::vector<EffectTerm> ripple_terms(const ErrorModel& model, const Eigen::MatrixXd& joint_values, std::size_t joint,
                                     double times_a_turn);

/// Torque (force for a prismatic joint) about every joint's axis of a unit mass at each later joint frame and the tip,
/// where gravity is one: joints x N for joint values joints x N.
Eigen::MatrixXd gravity_torques(const ErrorModel& model, const Eigen::MatrixXd& joint_values);

/// Compliance of the joints under gravity with few terms. Where the URDF states link masses each revolute joint gets
/// one with the torque of those masses; else one for each distinct torque that a mass at a later joint frame or at the
/// tip exerts. Torques that are small beside the largest of the robot, or that differ little from others of the same
/// joint or from a constant, are left out. Divided by their largest.
std::vector<EffectTerm> load_terms(const ErrorModel& model);

/// One gain per moving joint: `value` is its share.
std::vector<EffectTerm> gain_terms(const ErrorModel& model);

/// Both: what joints may be expected to do where nothing is known of them.
std::vector<EffectTerm> load_and_gain_terms(const ErrorModel& model);

}  // namespace kdl_calibration
