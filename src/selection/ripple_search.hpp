#pragma once

#include <Eigen/Core>
#include <vector>

#include "selection/effect_candidates.hpp"

namespace kdl_calibration {

/// The residual rows of a model, and their derivatives by a small motion of each joint about its own axis.
struct RippleData {
  const ErrorModel& model;              ///< rigid
  const Eigen::MatrixXd& joint_values;  ///< joints x configurations
  const LinearRows& rows;               ///< of the model with all its columns
  const LinearRows& joints;             ///< of the same configurations, one column per joint
  Eigen::MatrixXd information;          ///< J^T J plus prior information, of `columns`
  std::vector<Eigen::Index> columns;    ///< the model's columns
  Eigen::VectorXd values;               ///< of all columns of `rows`
};

/// Sine and cosine terms of the ripple frequencies of revolute joints, most significant first. Frequencies from 2 to
/// 400 per turn are tried, in steps of half a period over the joint's range. Frequencies above half the rate of a
/// lattice of joint values (Nyquist) are excluded. Each found term is removed from the residuals before the next
/// search.
///
/// Each configuration gives one sample of two sums of (motion x residual), so that errors common to its rows count
/// once. Test: Hotelling's T^2 against zero, p < 0.001 corrected for the number of frequencies tried.
std::vector<EffectTerm> find_ripple(RippleData data, int threads);

}  // namespace kdl_calibration
